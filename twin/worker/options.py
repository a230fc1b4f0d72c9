"""Options of a worker, as its command line says them: how many slots a rig on a GPU gets, whether
recordings are possible."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import msgspec

from schemas.case import Case
from schemas.sections.view_mode import RECORDER, ViewMode
from schemas.wire.control import Share
from twin.base.errors import UsageError
from twin.base.gpu.slot_count import MemoryCount
from twin.fabric.endpoint import LOOPBACK
from twin.fabric.keys.key_file import MemberKey

GPU_SLOTS = 128
"""Slots of a worker on a GPU unless the user says otherwise, where they fit: with more it gets
little faster, and other workers get less to do."""

_RECORDER = {"viewer": "drivetwin", "rerun": "rerun-sdk"}
"""Package that a recorder imports -> distribution that brings it."""


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """Options of a worker that serves one conductor with one rig at a time."""

    connect: str
    """Endpoint of the conductor."""
    namespace: str = "twin"
    key: MemberKey | None = None
    """The worker's key; None: it has none, or needs none, see ``handed``."""
    key_path: Path | None = None
    """Where that lies, for simulators and recorders; with it the rig's own sessions are TLS too."""
    handed: str = ""
    """Endpoint by which it joins a conductor that has started it, of a socket without a name;
    empty: as others do."""
    slots: int = 1
    fit: bool = False
    """Take fewer if a GPU's free memory holds no more."""
    device: str = "cpu"
    drive_listen: str = LOOPBACK
    """Where simulators listen for remote stacks (``autonomy.placement: node``)."""
    join_dir: str = ""
    """Folder in which rigs for remote stacks are announced."""
    view: ViewMode | None = None
    """What simulators show; None: what the campaign says."""
    until_done: bool = False
    drain_s: float = 0.0
    """How long running cases may go on after SIGTERM [s]."""
    started_again: bool = False
    """Who started it does so again unless it ends with 0: it then ends with 75 while cases are
    left."""
    away_s: float | None = None
    """Without an answer for so long, and with nothing in hand, it leaves; None: it waits [s]."""
    walltime_s: float | None = None
    """The allocation ends so long after the start [s]; None: no end is known."""
    memory_gb: float | None = None
    """Most memory that the processes of a rig may use together; None: no limit [GB]."""
    tags: tuple[str, ...] = ()
    """Tags that campaigns may ask for."""
    site: str = ""
    """Site whose name is added to the host's, :mod:`schemas.wire.site_name`; empty: none."""
    share: Share | None = None
    """Cases that the worker prefers, where several work side by side; None: any."""
    spool: Path | None = None
    """Folder for results that the conductor has not got yet."""


def fitting(device: str, slots: int, case: Case) -> int:
    """Number of slots, at most ``slots``, that fit into what is free on ``device``."""
    options = ("--case", "-", "--slots", str(slots), "--device", device)
    fits = MemoryCount(msgspec.json.encode(case), options).slots()
    return slots if fits is None else min(slots, fits)


def lacking_recorder(view: ViewMode | None) -> dict[str, str]:
    """:attr:`schemas.wire.control.Hello.lacks`, as far as recordings go.

    Args:
        view: what the worker was told to do instead of what campaigns say; None: nothing. Who says
            that nothing is recorded lacks nothing.

    Raises:
        UsageError: it was told to record, and cannot.
    """
    missing = [name for name in _RECORDER if importlib.util.find_spec(name) is None]
    if not missing or (view is not None and not view.records):
        return {}
    package = missing[0]
    if view is not None:
        raise UsageError(
            f"--view {view.value}: recordings need the package {package}, which is not installed; "
            f"{_install(package)}, or give --view live or --view none"
        )
    return {RECORDER: f"no package {package}: {_install(package)}; or start it with --view live"}


def _install(package: str) -> str:
    if package == "viewer":
        return "pip uninstall drivetwin-worker, then pip install drivetwin"
    return f"pip install {_RECORDER[package]}"
