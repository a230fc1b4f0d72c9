"""Runs a stack on the bus: the stack's end of the lockstep."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import msgspec
import numpy as np

from devkit.bridges import ScriptBridge
from devkit.hosting.faults import is_machines, line_buffered, refusal, told
from devkit.hosting.foreign import Ending, ForeignProcess, drive_variables, run_command
from devkit.hosting.foreign import watch_lifeline as watch_script_lifeline
from devkit.hosting.foreign_place import placed, vacate
from devkit.stack import (
    Observation,
    Stack,
    StackError,
    StackMissingError,
    load_stack,
    looked_at,
    reads_of,
)
from schemas import SCHEMA_VERSION
from schemas.messages import Commands
from schemas.sections.foreign import Foreign
from schemas.sections.stack_identity import StackSource
from schemas.wire.expected import Expected
from twin.base.errors import (
    EXIT_FAILED,
    EXIT_INFRASTRUCTURE,
    InfrastructureError,
    RefusedError,
    StackFaultError,
    TwinError,
    UsageError,
)
from twin.base.files import write_atomic
from twin.base.gpu import cuda
from twin.base.pauses import settle
from twin.base.process import (
    PARENT_VARIABLE,
    bind_to_parent,
    leave_signals_to_the_parent,
    watch_lifeline,
)
from twin.fabric.bus import Bus
from twin.fabric.drive import Incoming, StackEnd
from twin.fabric.keys.key_file import MemberKey, read_private
from twin.fabric.zenoh_bus import open_bus
from twin.sandbox.start import enter
from twin.sandbox.view import SandboxView
from twin.stack_identity.identity import Named, confirm, shown_name
from twin.stack_identity.loaded import LoadedModules

CONNECT_TIMEOUT_S = 20.0
"""Longest time the simulator may take to answer [s]."""


@dataclass(frozen=True, slots=True)
class HostOptions:
    """One rig and the stack to run on it."""

    connect: str
    rig: str
    namespace: str
    slots: int
    stack: str
    parameters: dict[str, Any]
    key: MemberKey | None = None
    """The key that the rig gave its stack, for a simulator that listens with TLS."""
    foreign: Foreign | None = None
    """A command to start: the stack itself, or what ``stack`` is the bridge to."""
    expected: Sequence[Expected] = ()
    """Perception that the rig's first cases will look with."""
    source: StackSource = field(default_factory=StackSource)
    """What the stack consisted of when the campaign was submitted."""
    view: SandboxView | None = None
    """The sandbox that it enters when it has fetched its files; None: it is in one, or in none."""

    @property
    def named(self) -> Named:
        """What the campaign says of the stack."""
        return Named(self.stack, self.foreign, self.source.files)


def run_host(options: HostOptions) -> int:
    """Serve one rig until the process is ended or the simulator goes away; the exit code.

    1 says that the stack itself has failed, also before its first case; anything that is the
    machine's doing has another code.
    """
    line_buffered()
    if options.foreign is not None:
        return _run_foreign(options, options.foreign)
    supervised = bool(os.environ.get(PARENT_VARIABLE))
    bind_to_parent()
    if supervised:
        watch_lifeline()
        leave_signals_to_the_parent()
    else:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    return _run_stack(options, None)


def _run_stack(options: HostOptions, script: ForeignProcess | None) -> int:
    """Load the stack and serve its rig; the exit code."""
    try:
        return _serve_rig(options, script)
    except TwinError:
        raise
    except Exception as error:  # of ours: what a stack raises is dealt with where it is called
        told(error)
        return EXIT_INFRASTRUCTURE


def _run_foreign(options: HostOptions, foreign: Foreign) -> int:
    """A stack, or the script behind a bridge, in a process of its own."""
    key, forget_key = _key_of_script(options.key, foreign)
    variables = drive_variables(
        connect=options.connect,
        namespace=options.namespace,
        rig=options.rig,
        slots=options.slots,
        parameters=options.parameters,
        key=key,
    )
    if foreign.repository is not None:  # its files are read-only, also for root
        variables["PYTHONDONTWRITEBYTECODE"] = "1"
    # From here on nothing outlives the worker: neither a fetch of files nor what runs in them.
    supervised = os.environ.pop(PARENT_VARIABLE, "") != ""

    def clear() -> None:
        forget_key()
        vacate(foreign, options.rig)

    ending = Ending(clear)
    watch_script_lifeline(supervised=supervised, ending=ending)
    try:
        try:
            confirm(options.named, options.source, options.parameters)
        except RefusedError as error:
            _refuse(options, error)
            raise
        command, folder = placed(foreign, options.rig)
        if options.view is not None:
            _enter(options, options.view, foreign, command, folder)
        script = ForeignProcess(command, variables, folder)
        return _run_stack(options, script) if options.stack else run_command(script, ending)
    finally:
        ending()


def _enter(
    options: HostOptions,
    view: SandboxView,
    foreign: Foreign,
    command: list[str],
    folder: str | None,
) -> NoReturn:
    """Become this program in a sandbox, which runs ``command`` in ``folder``."""
    here = Foreign(command=command, bridge=foreign.bridge)
    words = [sys.executable, "-m", "devkit", "host", "--connect", options.connect]
    words += ["--rig", options.rig, "--namespace", options.namespace]
    words += ["--slots", str(options.slots), "--stack", options.stack]
    words += ["--parameters", json.dumps(options.parameters)]
    words += ["--expected", msgspec.json.encode(options.expected).decode()]
    words += ["--foreign", msgspec.json.encode(here).decode()]
    if folder is not None:
        variables = {**view.variables, "PYTHONDONTWRITEBYTECODE": "1"}
        readable = [*view.readable, Path(folder)]
        view = replace(view, readable=readable, folder=Path(folder), variables=variables)
    enter(words, view)


def _key_of_script(key: MemberKey | None, foreign: Foreign) -> tuple[str, Callable[[], None]]:
    """Path of the key as the script sees it, and what removes what was made for that."""
    if key is None or foreign.image is None:
        return str(key.path) if key else "", lambda: None
    # Nothing of the host is seen in a container but /tmp, not even the worker's open files.
    folder = Path(tempfile.mkdtemp(prefix="drivetwin-", dir="/tmp"))
    write_atomic(folder / "stack.key", read_private(key.path), mode=0o600)
    return str(folder / "stack.key"), lambda: shutil.rmtree(folder, ignore_errors=True)


def _serve_rig(options: HostOptions, script: ForeignProcess | None) -> int:
    bus = _open_bus(options)
    try:
        link = StackEnd(bus, options.rig, options.slots)
        try:
            stack, loaded = _loaded(
                options.named, options.source, options.slots, options.parameters
            )
        except RefusedError as error:
            link.refuse(str(error))
            raise
        except StackFaultError as error:
            print(error, file=sys.stderr, flush=True)
            return EXIT_FAILED
        try:
            if isinstance(stack, ScriptBridge):
                stack.attach(script)
            serve(link, stack, loaded, _expected_by(stack, options.expected))
        except RefusedError as error:
            link.refuse(str(error))
            raise
        finally:
            stack.close()
    finally:
        bus.close()
    return 0


def _open_bus(options: HostOptions) -> Bus:
    return open_bus(
        "peer",
        connect=[options.connect],
        namespace=options.namespace,
        key=options.key,
        connect_timeout_s=CONNECT_TIMEOUT_S,
    )


def _refuse(options: HostOptions, error: RefusedError) -> None:
    """Tell the simulator why the command of a stack is not started."""
    bus = _open_bus(options)
    try:
        StackEnd(bus, options.rig, options.slots).refuse(str(error))
    finally:
        bus.close()


def _loaded(
    named: Named, source: StackSource, slots: int, parameters: dict[str, Any]
) -> tuple[Stack, LoadedModules | None]:
    """The stack, whose traceback is told if there is one, and what watches its modules.

    Raises:
        StackFaultError: it cannot be loaded, which is its own doing; one line.
        InfrastructureError: there is no such stack here, or the machine is to blame.
        RefusedError: it is not the one that was submitted; one line.
    """
    stack_files = confirm(named, source, parameters) if named.foreign is None else None
    loaded = LoadedModules(stack_files, shown_name(named)) if stack_files is not None else None
    try:
        stack = load_stack(named.stack, slots, parameters)
    except StackError as error:
        cause = error.__cause__
        told(cause)
        machines = cause is not None and is_machines(cause) and not isinstance(cause, UsageError)
        if machines or isinstance(error, StackMissingError):
            raise InfrastructureError(str(error)) from None
        raise StackFaultError(f"stack: {error}") from None
    if loaded is not None:
        loaded.check()
    return stack, loaded


def _expected_by(stack: Stack, expected: Sequence[Expected]) -> Exception | None:
    """:func:`expect`; what it raised is told with the first cases, which it is about."""
    try:
        expect(stack, expected)
    except RefusedError:
        raise
    except Exception as error:
        return error
    return None


def serve(
    link: StackEnd,
    stack: Stack,
    loaded: LoadedModules | None = None,
    failed: Exception | None = None,
) -> None:
    """Answer every seq with the stack's commands, until the simulator goes away.

    After an exception the answer is its reason, also to whoever did not hear it the first time.

    Args:
        link: the stack's end of the lockstep.
        stack: what is asked.
        loaded: watches which modules it loads.
        failed: what was raised before there was anything to answer.

    Raises:
        InfrastructureError: the simulator went away.
        RefusedError: a file is not what the campaign was submitted with.
    """
    if failed is not None:
        told(failed)
    link.takes_device_frames = takes_device_frames(stack)
    link.reads = reads_of(type(stack))
    settle()
    while True:
        incoming = link.receive(lambda: None)
        if failed is None:
            try:
                commands = answer(stack, incoming)
                if loaded is not None:
                    loaded.check()
            except RefusedError:
                raise
            except Exception as error:
                told(error)
                failed = error
        if failed is not None:
            commands = refusal(incoming.tick.seq, failed)
        sys.stdout.flush()  # what it printed is there before its answer is
        link.answer(commands)


def expect(stack: Stack, expected: Sequence[Expected]) -> None:
    """Have the stack load what its cases need, while the simulator builds its world."""
    if takes_device_frames(stack) and any(
        expectation.device.startswith("cuda") for expectation in expected
    ):
        cuda.prepare()
    if isinstance(stack, Stack):  # one that is none of ours may lack the method
        stack.expect(expected)


def takes_device_frames(stack: Stack) -> bool:
    """Whether the class of ``stack`` itself says so: one that inherits from a stack that does may
    look at its arrays as NumPy's."""
    return bool(vars(type(stack)).get("takes_device_frames", False))


def answer(stack: Stack, incoming: Incoming) -> Commands:
    """The stack's commands for one seq, and what they took."""
    begun_s = time.perf_counter()
    commands = step(stack, incoming)
    # A stack that is none of ours may lack the method.
    costs = stack.costs() if isinstance(stack, Stack) else []
    wall_s = time.perf_counter() - begun_s
    seq = incoming.tick.seq
    return Commands(v=SCHEMA_VERSION, seq=seq, commands=commands, costs=costs, wall_s=wall_s)


class Inline:
    """A stack in the simulator's process, which names this class and imports none of it."""

    def __init__(
        self, entry_point: str, slots: int, parameters: dict[str, Any], source: StackSource
    ) -> None:
        """Load the stack; ``source``: what it consisted of when the campaign was submitted.

        Raises:
            StackFaultError: it cannot be loaded, which is its own doing; one line.
            InfrastructureError: there is no such stack here.
            RefusedError: it is not the one that was submitted; one line.
        """
        self._stack, self._loaded = _loaded(
            Named(entry_point, None, source.files), source, slots, parameters
        )
        self.takes_device_frames = takes_device_frames(self._stack)
        self.reads = reads_of(type(self._stack))

    def answer(self, incoming: Incoming) -> Commands:
        """The commands for one seq, or the reason why there are none.

        Raises:
            RefusedError: a file is not what the campaign was submitted with; one line.
        """
        try:
            commands = answer(self._stack, incoming)
            if self._loaded is not None:
                self._loaded.check()
            return commands
        except RefusedError:
            raise
        except (Exception, SystemExit) as error:  # who leaves would take the simulator along
            told(error)
            return refusal(incoming.tick.seq, error)
        finally:
            sys.stdout.flush()

    def close(self) -> None:
        """Release what the stack holds; one that cannot is no reason for anything."""
        try:
            self._stack.close()
        except Exception:
            traceback.print_exc()


def step(stack: Stack, incoming: Incoming) -> list[Any]:
    """New episodes, then one step of the stack."""
    for episode in incoming.episodes:
        stack.reset(episode.slot, episode)
    tick = incoming.tick
    return stack.step(
        Observation(
            seq=tick.seq,
            active=np.array(tick.active, np.bool_),
            token=np.array(tick.token, np.int64),
            tick=np.array(tick.tick, np.int32),
            sim_time_ns=np.array(tick.sim_time_ns, np.int64),
            sensors=looked_at(incoming.sensors, type(stack)),
            counts=incoming.counts,
        )
    )
