"""Clocks, disks and limits of a host."""

from __future__ import annotations

import random
import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
from fabric import Fabric
from host_files import fill
from kinds import Body, fault

OPEN_FILES, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
"""What every process starts with."""
FILE_BYTES_MAX = 12288
"""Less than the frames of a rig need (13,888), more than a case's KPIs (10,961) [bytes]."""


def _step(offset_s: int) -> Body:
    """The wall clock of one host or of both; healing steps it back, which is a step as well."""

    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        hosts = dice.choice((fabric.hosts, fabric.hosts[:1], fabric.hosts[1:]))
        for host in hosts:
            fabric.files.step_clock(host.name, offset_s)
        yield f"{offset_s:+d} s on {len(hosts)} host(s)"
        for host in hosts:
            fabric.files.step_clock(host.name, 0)

    return body


fault("clock step of +1 h", (1.5, 3.0), extras=("clock",), group="clock")(_step(3600))
fault("clock step of -1 h", (1.5, 3.0), extras=("clock",), group="clock")(_step(-3600))


@fault("/dev/shm full", (3.0, 5.0), group="shm", stormy=True)
def shm_full(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """Full while a rig starts: its predecessor is killed."""
    simulator = fabric.victim("simulator", dice)
    if simulator is None:
        return
    ballast = fill(fabric.files.shm)
    with suppress(psutil.NoSuchProcess):
        simulator.kill()
    yield f"full, SIGKILL simulator {simulator.pid}"
    ballast.unlink()


def _limit(process: psutil.Process, kind: int, number: int) -> None:
    with suppress(psutil.NoSuchProcess, ProcessLookupError):
        _, hard = resource.prlimit(process.pid, kind)
        # A stack in its sandbox has a limit that nobody raises.
        resource.prlimit(
            process.pid, kind, (hard if number == resource.RLIM_INFINITY else number, hard)
        )


@fault("memory file full", (3.0, 5.0), group="fsize", stormy=True)
def memory_file_full(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """No file may grow as large as a rig's shared frames while a rig starts."""
    worker, simulator = fabric.victim("worker", dice), fabric.victim("simulator", dice)
    if worker is None or simulator is None:
        return
    _limit(worker, resource.RLIMIT_FSIZE, FILE_BYTES_MAX)
    with suppress(psutil.NoSuchProcess):
        simulator.kill()
    yield f"{FILE_BYTES_MAX} bytes for worker {worker.pid}, SIGKILL simulator {simulator.pid}"
    with suppress(psutil.NoSuchProcess):
        for process in (worker, *worker.children(recursive=True)):
            _limit(process, resource.RLIMIT_FSIZE, resource.RLIM_INFINITY)


def _no_files(kind: str, also_killed: str = "") -> Body:
    """``also_killed`` is started again meanwhile, which takes the victim descriptors."""

    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        victim = fabric.victim(kind, dice)
        other = fabric.victim(also_killed, dice) if also_killed else None
        if victim is None or (also_killed and other is None):
            return
        try:
            used = victim.num_fds()
        except psutil.NoSuchProcess:
            return
        _limit(victim, resource.RLIMIT_NOFILE, used)
        words = f"{used} for {kind} {victim.pid}"
        if other is not None:
            with suppress(psutil.NoSuchProcess):
                other.kill()
            words += f", SIGKILL {also_killed} {other.pid}"
        yield words
        _limit(victim, resource.RLIMIT_NOFILE, OPEN_FILES)
        with suppress(psutil.NoSuchProcess):
            for child in victim.children(recursive=True):
                _limit(child, resource.RLIMIT_NOFILE, OPEN_FILES)

    return body


fault("open-file limit of conductor", (2.0, 4.0), group="files", stormy=True)(
    _no_files("conductor", "worker")
)
fault("open-file limit of worker", (2.0, 4.0), group="files", stormy=True)(
    _no_files("worker", "simulator")
)
fault("open-file limit of simulator", (0.5, 3.0), group="files", stormy=True)(
    _no_files("simulator")
)


@fault("disk full", (0.5, 3.0), group="disk", stormy=True)
def disk_full(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """Not a byte is left for journal, results and spool."""
    ballast = fill(fabric.files.disk)
    yield "full"
    ballast.unlink()


@fault("read-only run folder", (0.5, 3.0), group="disk", stormy=True)
def read_only(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """Nothing can be made, replaced or removed in any folder of the run."""
    changed: list[Path] = []
    for folder in (fabric.state, *fabric.state.rglob("*/")):
        with suppress(OSError):  # removed meanwhile
            folder.chmod(0o555)
            changed.append(folder)
    yield f"{len(changed)} folders"
    for folder in changed:
        with suppress(OSError):
            folder.chmod(0o755)
