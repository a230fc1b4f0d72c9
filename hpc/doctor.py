"""What is there on this host, and what of it will not work for campaigns. No decisions elsewhere.

:mod:`hpc.look` gathers :class:`Facts`; :func:`judge` says what they mean.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from hpc.scheduler import Partition
from schemas.words import none_of
from twin.base.files import SHARED

Level = Literal["ok", "note", "bad"]

SPACE_MIN_BYTES = 1 << 30
"""Less free space than this is worth a line [bytes]."""
PYTHON_MIN = (3, 11)


@dataclass(frozen=True, slots=True)
class Address:
    """One address of this host."""

    interface: str
    address: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """Facts of a host; empty where there is nothing."""

    scheduler: str
    """Name of the batch system, e.g. ``slurm``, or empty."""
    looked_for: tuple[str, ...]
    """Commands of batch systems that were looked for."""
    unusable: tuple[str, ...]
    """Batch systems of other distributions that are broken, a line each."""
    version: str
    answers: str
    """Why the scheduler's controller cannot be used; empty: it can."""
    partitions: tuple[Partition, ...]
    gpus: tuple[str, ...]
    containers: tuple[str, ...]
    folder: str
    filesystem: str
    """Type of the run folder's file system, e.g. ``nfs4``."""
    writable: str
    """Why the run folder does not take a file that is written, synced and renamed; empty: it
    does."""
    free_bytes: int | None
    quota: str
    addresses: tuple[Address, ...]
    port: str
    """Why no port can be listened at; empty: one can."""
    python: tuple[int, int, int]
    missing: tuple[str, ...]
    """Commands of ours that are not beside this Python."""
    site: str
    """The site file that is in effect, or empty."""


@dataclass(frozen=True, slots=True)
class DoctorLine:
    """One line of the diagnosis."""

    what: str
    level: Level
    found: str
    do: str = ""
    """What to do about it."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All lines, and whether jobs can be submitted from here."""

    lines: list[DoctorLine] = field(default_factory=list)
    can_submit: bool = True

    def as_json(self, facts: Facts) -> dict[str, Any]:
        """Facts for programs."""
        return {
            "can_submit": self.can_submit,
            "lines": [asdict(line) for line in self.lines],
            "facts": asdict(facts),
        }


def judge(facts: Facts) -> Diagnosis:
    """What works, what does not, what to do."""
    lines = [
        *_scheduler(facts),
        *(DoctorLine("plug-in", "note", line, "repair or uninstall it") for line in facts.unusable),
        *_partitions(facts),
        _gpus(facts),
        _containers(facts),
        *_folder(facts),
        *_network(facts),
        _software(facts),
        DoctorLine(
            "site file", "ok" if facts.site else "note", facts.site or "none, nothing is preset"
        ),
    ]
    blocking = ("scheduler", "partitions", "run folder", "software")
    can = not any(line.level == "bad" and line.what in blocking for line in lines)
    return Diagnosis(lines, can)


def _scheduler(facts: Facts) -> list[DoctorLine]:
    if not facts.scheduler:
        return [
            DoctorLine(
                "scheduler",
                "bad",
                none_of(facts.looked_for),
                "log in to a login node, or `hpc render` here and submit there",
            )
        ]
    if facts.answers:
        do = "wait and try again, or ask the site"
        return [DoctorLine("scheduler", "bad", f"{facts.version}: {facts.answers}", do)]
    return [DoctorLine("scheduler", "ok", facts.version)]


def _partitions(facts: Facts) -> list[DoctorLine]:
    if not facts.scheduler or facts.answers:
        return []
    if not facts.partitions:
        return [DoctorLine("partitions", "bad", "none that you may see", "ask the site for access")]
    lines = []
    for part in facts.partitions:
        words = [part.name, f"up to {part.limit}" if part.limit else "", part.nodes, part.gpus]
        up = part.state.lower() in ("", "up")
        offer = ", ".join(word for word in words if word) + ("" if up else f", {part.state}")
        lines.append(DoctorLine("partition", "ok" if up else "note", offer))
    if not any(part.gpus for part in facts.partitions):
        lines.append(
            DoctorLine("partition", "note", "no GPUs that the scheduler knows", "use --workers N")
        )
    return lines


def _gpus(facts: Facts) -> DoctorLine:
    if facts.gpus:
        return DoctorLine("GPUs of this host", "ok", ", ".join(facts.gpus))
    return DoctorLine("GPUs of this host", "note", "none; that is usual for a login node")


def _containers(facts: Facts) -> DoctorLine:
    if facts.containers:
        return DoctorLine("containers", "ok", ", ".join(facts.containers))
    return DoctorLine(
        "containers", "note", "no apptainer, ch-run or podman", "jobs run without an image"
    )


def _folder(facts: Facts) -> list[DoctorLine]:
    if facts.writable:
        do = "choose another with --out, or free some space"
        return [DoctorLine("run folder", "bad", facts.writable, do)]
    lines = [
        DoctorLine(
            "run folder", "ok", f"{facts.folder}: written, synced and renamed ({facts.filesystem})"
        )
    ]
    if facts.filesystem not in SHARED:
        lines.append(
            DoctorLine(
                "shared",
                "note",
                f"{facts.filesystem} is not a network file system",
                "if other nodes do not see this folder, give --nodes 1 or another --out",
            )
        )
    else:
        lines.append(DoctorLine("shared", "ok", f"{facts.filesystem}, a network file system"))
    if facts.free_bytes is not None:
        level: Level = "ok" if facts.free_bytes >= SPACE_MIN_BYTES else "note"
        lines.append(DoctorLine("space", level, f"{facts.free_bytes / (1 << 30):.1f} GiB free"))
    if facts.quota:
        lines.append(DoctorLine("quota", "ok", facts.quota))
    return lines


def _network(facts: Facts) -> list[DoctorLine]:
    outward = [a for a in facts.addresses if not a.address.startswith("127.")]
    shown = ", ".join(f"{a.address} ({a.interface})" for a in outward)
    lines = [
        DoctorLine("addresses", "ok", f"{shown}; choose with --interface")
        if outward
        else DoctorLine(
            "addresses", "note", "loopback only", "nodes must have one; --nodes 1 works"
        )
    ]
    if facts.port:
        lines.append(
            DoctorLine("ports", "note", facts.port, "the same on a node would stop the job")
        )
    else:
        lines.append(DoctorLine("ports", "ok", "any free port; the conductor says which it took"))
    return lines


def _software(facts: Facts) -> DoctorLine:
    version = ".".join(str(number) for number in facts.python)
    if facts.python[:2] < PYTHON_MIN:
        return DoctorLine("software", "bad", f"Python {version}", "at least 3.11 is needed")
    if facts.missing:
        python = f"Python {version} without {', '.join(facts.missing)}"
        return DoctorLine("software", "bad", python, "install drivetwin there, or give --bin")
    return DoctorLine("software", "ok", f"Python {version} with conductor, twin and devkit")
