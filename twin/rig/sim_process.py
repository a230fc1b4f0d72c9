"""The simulator process of a rig, ``python -m twin sim DEVICE``, and how a worker starts it.

It reads what it is to do from the worker on standard input, which is also its lifeline, and answers
on standard output. So it may be started, and load, before there is a lease.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from twin.base.errors import RefusedError, StackFaultError, TwinError
from twin.base.gpu.first_use import begun
from twin.base.pauses import loading
from twin.base.process import RigChild, keep_to_itself, leave_signals_to_the_parent, spawn
from twin.rig.pipe import Broken, BuildRig, Faulted, Listening, Orders, RefusedPeer, Upstream

LOADED = (
    "cryptography.x509",  # reads keys
    "twin.fabric.zenoh_bus",
    "twin.rig.simulator",
    "twin.view.publisher",
    "twin.rig.engine",
)
"""Modules that a simulator loads while it has not been told what to build."""


def start_simulator(
    device: str, stack_log: IO[bytes], environment: Mapping[str, str] | None = None
) -> RigChild:
    """Start one that will compute on ``device``; the first message tells it what to build. Only
    from the main thread.

    Args:
        device: ``cpu`` or ``cuda:N``.
        stack_log: of the stack beside it, which it reads.
        environment: added to ours.
    """
    log = tempfile.TemporaryFile()  # noqa: SIM115
    command = [sys.executable, "-m", "twin", "sim", device]
    process = spawn(
        command,
        environment=environment,
        log=log,
        pipe_output=True,
        descriptors=[stack_log.fileno()],
    )
    return RigChild(process, log)


def main(device: str) -> int:
    """Entry of ``twin sim``, of a process that is bound to its worker; the exit code."""
    leave_signals_to_the_parent()
    if not device.startswith("cuda"):  # memory of a GPU is shared by the driver's own rules
        keep_to_itself()
    # Whatever prints by mistake must not end up between the messages.
    out = Upstream(os.fdopen(os.dup(1), "wb", buffering=0))
    os.dup2(2, 1)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # an inline stack's words, as they are said
    orders = Orders(0)
    with contextlib.ExitStack() as at_end:  # its session ends when the worker knows why
        try:
            _run(_first(device, orders), orders, out, at_end)
        except StackFaultError as error:  # of a stack in this process, before its first case
            out.send(Faulted(str(error)))
            return error.exit_code
        except TwinError as error:
            reason = "refused" if isinstance(error, RefusedError) else "crash"
            out.send(Broken(reason, str(error)))
            return error.exit_code
        except MemoryError as error:
            out.send(Broken("out_of_memory", f"out of memory {error}".strip()))
            return 3
        except ValueError as error:
            # What the engine refuses: one line, for people.
            out.send(Broken("crash", str(error)))
            return 3
        except Exception as error:
            sys.excepthook(*sys.exc_info())
            out.send(Broken("crash", f"{type(error).__name__}: {error}"))
            return 3
    return 0


def _first(device: str, orders: Orders) -> BuildRig:
    """Order that says what to build; until it comes, what takes long to load is loaded."""
    build = orders.next(0)
    if build is None:
        waking = threading.Thread(target=_wake, args=(device,), name="wake", daemon=True)
        waking.start()
        with loading():
            for name in LOADED:
                importlib.import_module(name)
            waking.join()
        build = orders.next(None)
    assert isinstance(build, BuildRig)
    return build


def _wake(device: str) -> None:
    begun(device)
    with contextlib.suppress(Exception):  # whoever needs it says what is wrong with it
        importlib.import_module("twin.world.kernel_cache").wake(device)


def _run(build: BuildRig, orders: Orders, out: Upstream, at_end: contextlib.ExitStack) -> None:
    from twin.fabric.drive import STACK_BYTES_MAX
    from twin.fabric.endpoint import allow_plain, is_exposed
    from twin.fabric.keys.key_file import load_key
    from twin.fabric.keys.rig_keys import key_in_memory
    from twin.fabric.keys.roles import Role
    from twin.fabric.refusals import refusals_logged
    from twin.fabric.zenoh_bus import open_bus
    from twin.rig.simulator import Simulator
    from twin.view.publisher import ViewOptions, open_view

    if is_exposed(build.view_connect):
        allow_plain()
    key = load_key(Path(build.key), Role.worker) if build.key else None
    rig_key = None
    if build.rig_key:
        with key_in_memory(build.rig_key) as path:
            rig_key = load_key(path, Role.worker)
    if rig_key is not None or key is not None:  # the view listens, too
        name = build.rig
        at_end.enter_context(
            refusals_logged(lambda why: out.send(RefusedPeer(f"rig {name} {why}")))
        )
    bus = open_bus(
        "peer",
        listen=[build.listen],
        namespace=build.namespace,
        key=rig_key,
        message_bytes_max=STACK_BYTES_MAX,
    )
    at_end.callback(bus.close)
    options = ViewOptions(build.view, build.view_namespace, build.view_connect, key)
    view = open_view(build.rig, options)
    out.send(Listening(bus.endpoints[0], view.endpoint))
    Simulator(bus, build, orders, out, view).run()
