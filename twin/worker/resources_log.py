"""The thread that keeps a worker's resource log.

It is apart from the worker's loop because a shared file system may hang: the log then has a gap,
and nobody waits for it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import msgspec

from schemas.files.resources import PART_SUFFIX, PARTS_FOLDER, PERIOD_S, ResourceSample
from schemas.wire.control import Lease
from twin.base.errors import storage_error
from twin.worker.held import CampaignWork

PERIOD_NS = PERIOD_S * 1_000_000_000
FIRST_S = 1.0
"""The counters are first read so long after the start: workers of cases that simulate nothing have
mostly ended by then, and never load what reads them [s]."""


class ResourceLog:
    """Samples every :data:`PERIOD_S` while there is work, into the campaigns' folders.

    Args:
        worker: id of the worker, which names its part.
        host: where it runs.
        device: ``cpu`` or ``cuda:N``.
        say: receives a line when the log cannot be written, once.
    """

    def __init__(self, worker: str, host: str, device: str, say: Callable[[str], None]) -> None:
        self.work: tuple[CampaignWork, ...] = ()
        """Cases that the worker holds, by campaign; set by the worker's loop."""
        self._worker = worker
        self._host = host
        self._device = device
        self._say = say
        self._said = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="resources", daemon=True)

    def start(self) -> None:
        """Begin to sample."""
        self._thread.start()

    def close(self) -> None:
        """Sample no more; a write that hangs is not waited for."""
        self._stop.set()
        self._thread.join(0.5)

    def _run(self) -> None:
        if self._stop.wait(FIRST_S):
            return
        from twin.worker.resources import Meter

        meter = Meter(self._worker, self._host, self._device)
        meter.sample((), time.time_ns(), time.monotonic_ns())
        while not self._stop.wait(until_next(time.time_ns())):
            work = self.work
            for campaign, sample in zip(
                work, meter.sample(work, time.time_ns(), time.monotonic_ns()), strict=False
            ):
                self._append(Path(campaign.out), sample)

    def _append(self, out: Path, sample: ResourceSample) -> None:
        path = out / PARTS_FOLDER / f"{self._worker}{PART_SUFFIX}"
        try:
            append_sample(path, sample)
        except OSError as error:
            if not self._said:
                self._say(f"{storage_error(error, str(path))}; the resource log has a gap")
            self._said = True


def work_of(leases: Iterable[Lease]) -> tuple[CampaignWork, ...]:
    """Leases that the worker holds, by campaign folder."""
    batches: dict[str, list[int]] = {}
    for lease in leases:
        batches.setdefault(lease.out, []).append(lease.case.variation.batch)
    return tuple(CampaignWork(out, len(held), _only(held)) for out, held in batches.items())


def until_next(time_ns: int) -> float:
    """Time until the next multiple of the period, at which all workers sample [s]."""
    return (PERIOD_NS - time_ns % PERIOD_NS) * 1e-9


def append_sample(path: Path, sample: ResourceSample) -> None:
    """Add one line to a part; opened anew each time, so that other hosts see it at once.

    Raises:
        OSError: it cannot be written.
    """
    line = msgspec.json.encode(sample) + b"\n"
    try:
        file = path.open("ab", buffering=0)
    except FileNotFoundError:
        path.parent.mkdir(exist_ok=True)
        file = path.open("ab", buffering=0)
    with file:
        file.write(line)


def _only(batches: Sequence[int]) -> int:
    return batches[0] if len(set(batches)) == 1 else 0
