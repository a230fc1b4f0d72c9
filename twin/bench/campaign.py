"""A whole campaign by `conductor run`, and where its wall time goes.

The real processes run: conductor, worker, simulator, stack. Simulators keep a profile of their loop
(:mod:`twin.rig.profile`) in a folder that the bench reads.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from schemas.words import counted
from twin.base.errors import (
    EXIT_FAILED,
    EXIT_PASS,
    EXIT_USAGE,
    InfrastructureError,
    UsageError,
)
from twin.rig.profile import FOLDER_VARIABLE, QUARTERS, LoopProfile, Quarter
from twin.sensors.wanted import SENSORS_VARIABLE
from twin.worker.resources_gpu import Gpu

GPU_PERIOD_S = 0.2
"""How often the GPU's counters are read [s]."""

PARTS = {
    "physics": ("physics",),
    "render": ("render",),
    "inference": ("inference",),
    "transport": ("transport", "frames"),
    "conductor": ("idle", "orders"),
    "host": ("sense", "step", "stack", "messages", "refill", "results", "view"),
}
"""Shares of the wall time, and the laps of the loop that they are made of; the rest is the start of
the processes and the report at the end."""

TARGET_MS_PER_SIM_S = 10.0
"""Longest wall time on a GPU per simulated second of one case, from command to report [ms]."""
TARGET_REAL_TIME = 100.0
"""Least simulated time on a GPU of all cases together per wall time."""
TARGET_GPU_PERCENT = 85.0
"""Least utilisation of a GPU while most slots have a case [%]."""


@dataclass(frozen=True, slots=True)
class Request:
    """The campaign to run, and where."""

    campaign: str
    """Shipped name or path."""
    device: str
    out: Path
    """Folder for the runs."""
    cases: int | None = None
    """Number of cases, the first ones; None: all."""
    workers: str = "1"
    options: tuple[str, ...] = ()
    """Further options of `conductor run`, as rows of a rulebook."""


@dataclass(frozen=True, slots=True)
class SlotsRow:
    """Figures of a run with one number of slots."""

    slots: int
    cases: int
    fingerprint: str
    transport: str
    everything: bool
    """All sensors were read, also those that the stack does not look at."""
    unread: list[str]
    """Messages of sensors that the stack does not look at."""
    wall_s: float
    """Wall time from command to report [s]."""
    loop_s: float
    """Wall time from the first tick to the last [s]."""
    sim_s: float
    """Simulated time of all cases together [s]."""
    ticks: int
    frames: int
    slot_use: float
    """Share of the slots that had a case, over all ticks."""
    shares: dict[str, float]
    """Shares of the loop's time, by :data:`PARTS`; they sum to 1."""
    laps_s: dict[str, float]
    """Wall time of the loop by lap, finer than ``shares`` [s]."""
    quarters: list[Quarter]
    """The ticks by how many of the slots had a case."""
    round_trip_p50_ms: float
    round_trip_p99_ms: float
    gpu_percent: float | None
    """Mean while most slots had a case; None: no GPU, or it does not tell [%]."""
    gpu_memory_bytes: int | None
    """Most in use [bytes]."""

    @property
    def ms_per_sim_s(self) -> float:
        """Wall time, start and report included, per simulated second of one case [ms]."""
        return 1e3 * self.wall_s / self.sim_s

    @property
    def loop_ms_per_sim_s(self) -> float:
        """Wall time of the loop alone per simulated second [ms]."""
        return 1e3 * self.loop_s / self.sim_s

    @property
    def real_time(self) -> float:
        """Simulated time of all cases together per wall time."""
        return self.sim_s / self.wall_s

    def missed(self, device: str) -> list[str]:
        """Targets that were missed; a CPU has none."""
        if not device.startswith("cuda"):
            return []
        misses = []
        if self.ms_per_sim_s > TARGET_MS_PER_SIM_S:
            misses.append(f"{self.ms_per_sim_s:.1f} of {TARGET_MS_PER_SIM_S:g} ms per simulated s")
        if self.real_time < TARGET_REAL_TIME:
            misses.append(f"real-time factor {self.real_time:.0f} of {TARGET_REAL_TIME:g}")
        if self.gpu_percent is not None and self.gpu_percent < TARGET_GPU_PERCENT:
            misses.append(f"GPU {self.gpu_percent:.0f} of {TARGET_GPU_PERCENT:g} %")
        return misses


DONE = re.compile(r"(\d+) of (\d+) cases? done")
"""How `conductor run` says in a log how far it is."""


def measure(
    request: Request,
    slots: int,
    report: Callable[[int, int], object] = lambda *_: None,
    *,
    everything: bool = True,
) -> SlotsRow:
    """Run the campaign once with ``slots`` slots per worker.

    ``report`` is told how many cases have ended, of how many. ``everything``: all sensors are read,
    otherwise those that the stack looks at.

    Raises:
        UsageError: the campaign cannot be run; its own words.
        InfrastructureError: it did not end.
    """
    name = f"{slots}" if everything else f"{slots}-read"
    folder = request.out / f"slots-{name}"
    if folder.exists():
        raise UsageError(f"{folder}: is there already; choose another --out, or remove it")
    profiles = folder.with_name(f"profile-{name}")
    profiles.mkdir(parents=True, exist_ok=True)
    command = [
        *(sys.executable, "-m", "conductor", "run", request.campaign, "--out", str(folder)),
        *("--workers", request.workers, "--slots", str(slots), "--device", request.device),
        *(() if request.cases is None else ("--cases", str(request.cases))),
        *request.options,
        *("--output", "json"),
    ]
    watcher = _GpuWatcher(request.device)
    begun_s = time.monotonic()
    environment = {**os.environ, FOLDER_VARIABLE: str(profiles.absolute())}
    environment[SENSORS_VARIABLE] = "all" if everything else "read"
    with watcher:
        code, printed, log = _run(command, environment, report)
    wall_s = time.monotonic() - begun_s
    if code == EXIT_USAGE:
        raise UsageError(log.strip())
    if code not in (EXIT_PASS, EXIT_FAILED) or not printed:
        tail = " ".join(log.split()[-40:])
        raise InfrastructureError(f"conductor run ended with {code}: {tail}")
    profiled = [
        msgspec.json.decode(path.read_bytes(), type=LoopProfile)
        for path in sorted(profiles.glob("*.json"))
    ]
    if not profiled:
        raise InfrastructureError(f"{request.campaign}: no simulator ran; was everything done?")
    return _row(json.loads(printed), profiled, wall_s, slots, watcher, everything=everything)


def _run(
    command: Sequence[str],
    environment: Mapping[str, str],
    report: Callable[[int, int], object],
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a run, which says how far it is."""
    log = []
    with tempfile.TemporaryFile("w+") as printed:
        child = subprocess.Popen(
            command, stdout=printed, stderr=subprocess.PIPE, text=True, env=environment
        )
        with child:
            assert child.stderr is not None
            try:
                for line in child.stderr:
                    log.append(line)
                    if match := DONE.search(line):
                        report(int(match[1]), int(match[2]))
            except BaseException:
                child.terminate()  # it drains; its workers end with it
                raise
        printed.seek(0)
        return child.returncode, printed.read(), "".join(log)


def _row(
    run: dict[str, Any],
    profiles: Sequence[LoopProfile],
    wall_s: float,
    slots: int,
    watcher: _GpuWatcher,
    *,
    everything: bool,
) -> SlotsRow:
    laps: dict[str, float] = {}
    for profile in profiles:
        for name, spent_s in profile.seconds.items():
            laps[name] = laps.get(name, 0.0) + spent_s
    whole_s = sum(laps.values()) or 1.0
    sim_s = sum(profile.sim_s for profile in profiles)
    first_s = min(profile.first_tick_s for profile in profiles)
    last_s = max(profile.last_tick_s for profile in profiles)
    full_s = max(profile.full_s for profile in profiles) or last_s
    ticks = sum(profile.ticks for profile in profiles)
    longest = max(profiles, key=lambda profile: profile.ticks)
    period_s = longest.period_s
    percent, memory = watcher.between(first_s, full_s)
    return SlotsRow(
        slots=slots,
        cases=run["cases"],
        fingerprint=run["fingerprint"],
        transport="/".join(sorted({profile.transport for profile in profiles})),
        everything=everything,
        unread=sorted({name for profile in profiles for name in profile.unread}),
        wall_s=wall_s,
        loop_s=last_s - first_s,
        sim_s=sim_s,
        ticks=ticks,
        frames=sum(profile.frames for profile in profiles),
        slot_use=sim_s / (ticks * slots * period_s),
        shares={
            part: sum(laps.get(name, 0.0) for name in names) / whole_s
            for part, names in PARTS.items()
        },
        laps_s={name: round(spent_s, 4) for name, spent_s in sorted(laps.items())},
        quarters=[
            _together([profile.quarters[index] for profile in profiles])
            for index in range(QUARTERS)
        ],
        round_trip_p50_ms=longest.round_trip_p50_ms,
        round_trip_p99_ms=longest.round_trip_p99_ms,
        gpu_percent=percent,
        gpu_memory_bytes=memory,
    )


def _together(parts: Sequence[Quarter]) -> Quarter:
    """One quarter of all simulators, with the laps named as in :data:`PARTS`."""
    seconds = {
        part: sum(quarter.seconds.get(name, 0.0) for quarter in parts for name in names)
        for part, names in PARTS.items()
    }
    return Quarter(sum(p.ticks for p in parts), sum(p.slot_ticks for p in parts), seconds)


class _GpuWatcher:
    """Reads a GPU's counters on a thread, while the block runs."""

    def __init__(self, device: str) -> None:
        self._gpu = Gpu(device)
        self._device = device
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gpu", daemon=True)
        self._samples: list[tuple[float, float | None, int | None]] = []

    def __enter__(self) -> None:
        if self._device.startswith("cuda"):
            self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(GPU_PERIOD_S):
            reading = self._gpu.read()
            self._samples.append((time.monotonic(), reading.percent, reading.memory_bytes))

    def between(self, first_s: float, last_s: float) -> tuple[float | None, int | None]:
        """Mean utilisation in a span of time [%], and the most memory ever in use [bytes]."""
        inside = [
            percent
            for time_s, percent, _ in self._samples
            if percent is not None and first_s <= time_s <= last_s
        ]
        memory = [used for _, _, used in self._samples if used is not None]
        return (
            sum(inside) / len(inside) if inside else None,
            max(memory) if memory else None,
        )


def as_json(request: Request, rows: Sequence[SlotsRow]) -> dict[str, Any]:
    """All of it as plain values."""
    return {
        "campaign": request.campaign,
        "device": request.device,
        "rows": [
            {
                **msgspec.to_builtins(row),
                "cases_per_min": 60.0 * row.cases / row.wall_s,
                "frames_per_s": row.frames / row.loop_s,
                "ms_per_sim_s": row.ms_per_sim_s,
                "loop_ms_per_sim_s": row.loop_ms_per_sim_s,
                "real_time_factor": row.real_time,
                "missed": row.missed(request.device),
            }
            for row in rows
        ],
    }


def lines(rows: Sequence[SlotsRow]) -> list[str]:
    """The table for people."""
    head = ["slots", "sensors", "cases/min", "x real time", "frames/s", "ms/sim s", "loop ms/sim s"]
    head += ["slot use", *PARTS, "trip p50 ms", "p99 ms", "GPU", "GPU GB", "transport"]
    table = [head]
    for row in rows:
        gpu = "-" if row.gpu_percent is None else f"{row.gpu_percent:.0f} %"
        memory = "-" if row.gpu_memory_bytes is None else f"{row.gpu_memory_bytes / 1e9:.1f}"
        table.append(
            [
                *(str(row.slots), "all" if row.everything else "read"),
                *(f"{60.0 * row.cases / row.wall_s:.1f}", f"{row.real_time:.1f}"),
                *(f"{row.frames / row.loop_s:,.0f}", f"{row.ms_per_sim_s:.1f}"),
                *(f"{row.loop_ms_per_sim_s:.1f}", f"{100 * row.slot_use:.0f} %"),
                *(f"{100 * share:.0f} %" for share in row.shares.values()),
                *(f"{row.round_trip_p50_ms:.2f}", f"{row.round_trip_p99_ms:.2f}"),
                *(gpu, memory, row.transport),
            ]
        )
    text = _columns(table)
    for row in rows:
        text.append(
            f"{counted(row.slots, 'slot')}, {_sensors(row)}: "
            f"{counted(row.cases, 'case')}, {row.sim_s:,.1f} "
            f"simulated s in {row.wall_s:.1f} s of wall time, {row.loop_s:.1f} s of it between "
            f"the first tick and the last; fingerprint {row.fingerprint[:16]}"
        )
        text += [f"  {line}" for line in _columns(_by_use(row))]
    return text


def _sensors(row: SlotsRow) -> str:
    if not row.unread:
        return "all sensors"
    unread = ", ".join(row.unread)
    return f"{'all sensors, also' if row.everything else 'without'} {unread}"


def _by_use(row: SlotsRow) -> list[list[str]]:
    """ms per tick while few and while many of the slots had a case: what does not fall with them
    is paid for slots that stand empty."""
    table = [["slots in use", "ticks", "cases per tick", *(f"{part} ms" for part in PARTS)]]
    for index, quarter in enumerate(row.quarters):
        if not quarter.ticks:
            continue
        laps_ms = [1e3 * quarter.seconds[part] / quarter.ticks for part in PARTS]
        use = f"to {100 * (index + 1) // QUARTERS} %"
        mean = f"{quarter.slot_ticks / quarter.ticks:.1f}"
        table.append([use, str(quarter.ticks), mean, *(f"{lap_ms:.2f}" for lap_ms in laps_ms)])
    return table


def _columns(table: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in table
    ]
