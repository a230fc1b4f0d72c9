"""How fast a campaign went, and how much faster than one case after the other: measured or missing.

Everything here is wall clock: it differs from run to run, and no result depends on it.
"""

from __future__ import annotations

import shlex
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from conductor.report.reading.dossier import CaseRow, Dossier, open_dossier
from conductor.report.reading.leases import Leases, read_leases
from schemas.words import unended
from twin.base.errors import UsageError
from twin.records.repeating import campaign_of, run_name


@dataclass(frozen=True, slots=True)
class RunPace:
    """Time that a run took; None: it was not measured."""

    cases: int
    """Cases with a result."""
    workers: int | None
    at_once: int
    """Most leases that were held at the same time; 0: not measured."""
    wall_s: float | None
    """Time in which at least one lease was held [s]."""
    control_hz: float | None
    """Control ticks of a case per second of its own wall time, median over the cases [Hz]."""
    real_time: float | None
    """Sim time of a case over its own wall time, median over the cases."""
    net_hz: float | None
    """Control ticks of all cases per second of the run [Hz]."""
    net_real_time: float | None
    """Sim time of all cases over the wall time of the run."""


@dataclass(frozen=True, slots=True)
class SpeedUp:
    """A run beside the same cases one after the other."""

    run: RunPace
    serial: RunPace | None
    serial_folder: str
    missing: str
    """Why there is no factor; empty: there is one."""

    @property
    def factor(self) -> float | None:
        """Wall time one after the other over wall time of the run."""
        if self.missing or self.serial is None or not self.serial.wall_s or not self.run.wall_s:
            return None
        return self.serial.wall_s / self.run.wall_s

    @property
    def efficiency(self) -> float | None:
        """The factor over the cases that ran at once, 0 to about 1."""
        factor = self.factor
        return factor / self.run.at_once if factor is not None and self.run.at_once else None


def speed_up(dossier: Dossier, leases: Leases, serial: Path | None) -> SpeedUp:
    """Compare with ``serial``, a folder in which the same campaign was run one case at a time.

    Raises:
        UsageError: the campaign was imported from logs, or ``serial`` is another campaign, ran
            with other software or on another kind of device, is not complete, or ran cases at once.
    """
    run = _pace(dossier, leases)
    if dossier.imported is not None:
        unknown = "logs do not say how long their simulators ran"
        if serial is not None:
            raise UsageError(f"--serial {serial}: {unknown}, so there is no speed-up; leave it out")
        return SpeedUp(run, None, "", unknown)
    if serial is not None:
        return SpeedUp(run, _serial_pace(dossier, serial), serial.name, _missing(dossier, run))
    if run.at_once == 1 and dossier.outcomes.complete:
        return SpeedUp(run, run, "", "")
    return SpeedUp(run, None, "", f"no run with one slot was given; {_serial_hint(dossier.folder)}")


def _serial_hint(folder: Path) -> str:
    command = shlex.join(["conductor", "run", campaign_of(folder), "--workers", "1"])
    return (
        f"in the folder that holds {run_name(folder)}: {command} --slots 1 --out serial, then "
        "--serial serial"
    )


def _missing(dossier: Dossier, run: RunPace) -> str:
    if not dossier.outcomes.complete:
        return f"this run: {unended(dossier.left, len(dossier.rows))}"
    return "" if run.wall_s else "this run has no timeline of its leases"


def _serial_pace(dossier: Dossier, serial: Path) -> RunPace:
    other = open_dossier(serial)
    if other.outcomes.digest != dossier.outcomes.digest:
        raise UsageError(
            f"--serial {serial}: holds campaign digest {other.outcomes.digest[:12]}, this is "
            f"{dossier.outcomes.digest[:12]}; run the same campaign with one worker and one slot"
        )
    leases = read_leases(serial)
    if not other.outcomes.complete or leases.most != 1:
        why = f"ran up to {leases.most} cases at once" if leases.most > 1 else "is not complete"
        raise UsageError(
            f"--serial {serial}: {why}; give a folder of a complete run with --workers 1 --slots 1"
        )
    if dossier.outcomes.complete:  # before, it may not know yet what it runs on
        _same_installation(dossier, other, serial)
    return _pace(other, leases)


def _same_installation(dossier: Dossier, other: Dossier, serial: Path) -> None:
    """A factor is about running at once, so nothing else may differ."""
    this, that = dossier.outcomes, other.outcomes
    if this.ran_on != that.ran_on:
        raise UsageError(
            f"--serial {serial}: ran on {', '.join(that.ran_on) or 'no device'}, this on "
            f"{', '.join(this.ran_on) or 'no device'}; run it on the same kind of device"
        )
    if this.software != that.software:
        raise UsageError(
            f"--serial {serial}: ran with software {that.software[:12] or 'unknown'}, this with "
            f"{this.software[:12] or 'unknown'}; run it again with the same installation"
        )


def _pace(dossier: Dossier, leases: Leases) -> RunPace:
    rows = [row for row in dossier.rows if row.end.attempt and row.end.wall_s > 0]
    wall_s = leases.busy_s if leases.commits_s else None
    ticks = _sum(rows, "ticks")
    sim_s = _sum(rows, "sim_time_s")
    return RunPace(
        cases=len(rows),
        workers=len(leases.workers or {row.end.worker for row in rows if row.end.worker}) or None,
        at_once=leases.most,
        wall_s=wall_s,
        control_hz=_median(rows, lambda row: row.scalar("ticks")),
        real_time=_median(rows, lambda row: row.scalar("sim_time_s")),
        net_hz=ticks / wall_s if wall_s and ticks is not None else None,
        net_real_time=sim_s / wall_s if wall_s and sim_s is not None else None,
    )


def _sum(rows: list[CaseRow], scalar: str) -> float | None:
    known = [value for row in rows if (value := row.scalar(scalar)) is not None]
    return sum(known) if known else None


def _median(rows: list[CaseRow], value: Callable[[CaseRow], float | int | None]) -> float | None:
    """Median of a value per second of a case's wall time."""
    known = [amount / row.end.wall_s for row in rows if (amount := value(row)) is not None]
    return statistics.median(known) if known else None
