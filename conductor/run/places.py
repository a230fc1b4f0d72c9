"""Where the local workers of ``conductor run`` compute: which device, and which processor cores."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from msgspec import structs

from schemas.wire.control import Share
from twin.base.errors import UsageError
from twin.base.gpu.nvml import VisibleGpu, visible_gpus
from twin.base.worker_start import LocalWorker

WORKERS_MAX = 8
"""Local workers started by default on the CPU, at most."""

GPU_SLOTS_MAX = 256
"""Slots of a worker on a GPU unless the user says otherwise: more do not make it faster."""
BATCH = 32
"""Pictures that a network on a GPU takes at once, record 0013."""
SPARE = 4 / 3
"""Slots over those that cases of known lengths fill, because workers take them in stretches."""


@dataclass(frozen=True, slots=True)
class WorkersOption:
    """Value of ``--workers``."""

    count: int | None = None
    """Number of workers; None: by the cores."""
    per_gpu: int = 0
    """Number of workers on every GPU; 0: not on GPUs."""
    gpus: tuple[VisibleGpu, ...] = ()
    """GPUs that are here; without any, GPUs are not asked for."""


@dataclass(frozen=True, slots=True)
class WorkerPlace:
    """Where one worker computes."""

    device: str
    cores: tuple[int, ...] = ()
    """Processor cores; empty: wherever the system likes."""
    share: Share | None = None
    """Share of the cases that it prefers."""

    def placed(self, worker: LocalWorker) -> LocalWorker:
        """The worker, at this place."""
        return structs.replace(worker, device=self.device, cores=ranges(self.cores))


def parse_workers(text: str | None) -> WorkersOption:
    """Read ``--workers``.

    Raises:
        UsageError: neither a number nor a word for GPUs.
    """
    if text is None:
        return WorkersOption()
    if re.fullmatch(r"0{1,4}", text):
        raise UsageError(
            f"--workers {text}: nobody would work; for workers that you start yourself it is "
            "`conductor serve --campaign NAME --until-done`"
        )
    if re.fullmatch(r"[0-9]{1,4}", text):
        return WorkersOption(count=int(text))
    match = re.fullmatch(r"(?:([1-9])x)?cuda", text)
    if match is None:
        raise UsageError(
            f"--workers {text[:40]}: expected a number, cuda (one per GPU) or 4xcuda (four per GPU)"
        )
    return WorkersOption(per_gpu=int(match[1] or 1))


def where(asked: WorkersOption, device: str) -> tuple[WorkersOption, str]:
    """What ``--workers`` comes to here, and the device: without a GPU the CPU does it, and one line
    says so."""
    if not asked.per_gpu:
        return asked, device
    gpus = tuple(visible_gpus())
    if gpus:
        return replace(asked, gpus=gpus), gpus[0].device
    print("--workers cuda: no GPU here; workers simulate on the CPU", file=sys.stderr)
    return WorkersOption(), "cpu"


def on_gpus(
    gpus: Sequence[str], near: Sequence[Collection[int]], per_gpu: int
) -> list[WorkerPlace]:
    """``per_gpu`` workers on each GPU, with cores of their own near it, and cases; the
    first of every GPU, then the second of every GPU, and so on.

    Args:
        gpus: devices, ``cuda:N``.
        near: cores near each of them that may be used; GPUs of a socket have the same ones.
        per_gpu: workers on each.
    """
    wishes = [tuple(sorted(cores)) for cores in near] * per_gpu
    devices = [*gpus] * per_gpu
    places = []
    for index, (device, cores) in enumerate(zip(devices, wishes, strict=True)):
        sharers = [other for other, wish in enumerate(wishes) if wish == cores]
        turn, count = sharers.index(index), len(sharers)
        first, last = turn * len(cores) // count, (turn + 1) * len(cores) // count
        # A simulator, a stack and a worker: with one core they would only wait for each other.
        enough = len(cores) >= 2 * count
        nth, gpu = divmod(index, len(gpus))
        # Networks are mostly listed from small to large, and the first worker is ready first.
        stretch = per_gpu - 1 - nth
        share = Share(stretch, per_gpu, gpu, len(gpus)) if len(devices) > 1 else None
        places.append(WorkerPlace(device, cores[first:last] if enough else (), share))
    return places


def on_cpu(device: str, count: int | None, cores: int, left: int, slots: int) -> list[WorkerPlace]:
    """``count`` workers on one device; None: one per core, and no more than there is work for."""
    if count is None:
        count = max(1, min(cores, WORKERS_MAX, -(-left // slots)))
    return [WorkerPlace(device)] * count


def cpu_slots(left: int, workers: int) -> int:
    """Slots per worker on a CPU: two where each has four cases or more, else one.

    While a stack thinks its simulator waits, and two cases share the way between them. With more
    slots the first and the last cases take longer, and nothing is won.
    """
    return 2 if left >= 4 * max(1, workers) else 1


def gpu_slots(
    left: int, workers: int, fit: int | None, known_s: Sequence[float | None] = ()
) -> int:
    """Slots per worker on a GPU: all cases at once, up to what is useful and what fits.

    ``known_s``: lengths of the campaign's cases, None where it is not known. If all are, and none
    has ended yet, the longest ones begin first, and slots that would stand empty until the longest
    one ends are not made.
    """
    wanted = max(1, min(GPU_SLOTS_MAX, -(-left // max(1, workers))))
    lengths_s = [length_s for length_s in known_s if length_s is not None and length_s >= 0.0]
    if left and len(lengths_s) == len(known_s) == left and max(lengths_s) > 0.0:
        wanted = min(wanted, _slots_in_use(lengths_s, workers))
    return wanted if fit is None else max(1, min(wanted, fit))


def _slots_in_use(lengths_s: Sequence[float], workers: int) -> int:
    """Slots per worker of which most have a case until the longest case ends.

    Whole batches where there is more than one: a network takes as long for a batch that is not
    full.
    """
    together = sum(lengths_s) / max(lengths_s)
    slots = math.ceil(SPARE * together / max(1, workers))
    return slots if slots <= BATCH else round(slots / BATCH) * BATCH


def ranges(cores: Sequence[int]) -> str:
    """``0-3,8`` for 0, 1, 2, 3, 8."""
    parts: list[list[int]] = []
    for core in sorted(cores):
        if parts and core == parts[-1][1] + 1:
            parts[-1][1] = core
        else:
            parts.append([core, core])
    return ",".join(f"{a}-{b}" if a != b else str(a) for a, b in parts)
