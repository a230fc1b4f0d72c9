"""A worker that `conductor run` starts, before its conductor listens.

It reads no command line: what parses one takes as long to load as everything else that it needs.
"""

from __future__ import annotations

import os
import socket
import sys
import tempfile
from pathlib import Path

from schemas.files.json_text import JsonError, decode_json
from twin.base.command import run
from twin.base.errors import UsageError
from twin.base.process import keep_to_itself
from twin.base.worker_start import LocalWorker, WorkerStart
from twin.fabric.endpoint import NAMESPACE, SOCKET, allow_plain, demand_keys, is_tls
from twin.fabric.rig_folder import RigFolder
from twin.rig.sim_process import start_simulator
from twin.worker.allocation import stay_on, walltime_s
from twin.worker.options import WorkerOptions, lacking_recorder
from twin.worker.stack_process import Loading, load_stack


def begin_loading(device: str) -> Loading:
    """Have the processes of a rig that computes on ``device`` load."""
    folder, log = RigFolder(), tempfile.TemporaryFile()  # noqa: SIM115
    stack = load_stack(device, folder.path, log)
    return Loading(start_simulator(device, log), stack, folder, log)


def await_start(loading: Loading | None) -> WorkerStart:
    """Wait to be told whom to serve; from then on standard output and error go to the log.

    Raises:
        SystemExit: there is nobody to serve; ``loading`` is ended.
        UsageError: standard input says something else.
    """
    line = sys.stdin.buffer.readline()
    if not line:
        if loading is not None:
            loading.discard()
        sys.exit(0)
    try:
        start: WorkerStart = decode_json(line, WorkerStart)
    except JsonError as error:
        raise UsageError(f"worker -: standard input: {error}") from None
    if not is_tls(start.connect):  # as somebody typed it there
        allow_plain()
    if start.log:
        log = os.open(start.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
    return start


def _handed(handover: int) -> str:
    """Endpoint of the conductor's socket that was handed over; its descriptor stays open."""
    with socket.socket(fileno=handover) as ours:
        _, descriptors, _, _ = socket.recv_fds(ours, 1, 1, socket.MSG_CMSG_CLOEXEC)
    return f"{SOCKET}//proc/self/fd/{descriptors[0]}"


def main(text: str) -> None:
    """Entry of ``twin worker -``; ends the process.

    Args:
        text: a :class:`twin.base.worker_start.LocalWorker` as JSON.
    """
    run(lambda: _work(text), "twin")


def _work(text: str) -> None:
    try:
        local: LocalWorker = decode_json(text, LocalWorker)
    except JsonError as error:
        raise UsageError(f"worker -: {error}") from None
    keep_to_itself()  # its session and its keys are nothing for a stack of the same user
    if local.handover >= 0:
        os.set_inheritable(local.handover, False)
    demand_keys()  # whoever typed --insecure says so with the endpoint
    if local.cores:
        stay_on(local.cores)
    if local.view is not None and local.view.records:
        lacking_recorder(local.view)
    loading = begin_loading(local.device) if local.load_simulator else None
    # Beside those processes: this takes long, too.
    from twin.fabric.discovery import Target, choose_target
    from twin.fabric.keys.key_file import key_path
    from twin.fabric.keys.roles import Role
    from twin.worker.shell import Abilities, Worker

    abilities = Abilities.here()  # before it is told, so that it joins at once
    told = await_start(loading)
    path = key_path(told.key_path.absolute(), Role.worker) if told.key_path else None
    if told.handed:  # it needs no key, and reads none: that takes long, too
        target = Target(told.connect, NAMESPACE, None)
    else:
        target = choose_target(told.connect, None, NAMESPACE, told.key_path, Role.worker)
    options = WorkerOptions(
        connect=target.endpoint,
        namespace=target.namespace,
        key=target.key,
        key_path=path,
        handed=_handed(local.handover) if told.handed else "",
        slots=told.slots or 1,
        device=local.device,
        join_dir=local.join_dir,
        view=local.view,
        walltime_s=walltime_s(),
        memory_gb=local.memory_gb,
        share=told.share,
        spool=Path(local.spool) if local.spool else None,
    )
    sys.exit(Worker(options, loading, abilities).serve())
