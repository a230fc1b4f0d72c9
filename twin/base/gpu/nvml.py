"""Which GPU a device name means, as NVML knows it."""

from __future__ import annotations

import contextlib
import functools
import os
from dataclasses import dataclass
from typing import Any


@functools.cache
def library() -> Any:
    """NVML, initialized once, which takes 0.1 s, and for as long as this process lives.

    Raises:
        pynvml.NVMLError: there is no driver.
    """
    import pynvml

    pynvml.nvmlInit()
    return pynvml


def visible_device(index: int, visible: str | None) -> int | str:
    """NVML's index or UUID of the ``index``-th device that CUDA sees.

    Args:
        index: as in ``cuda:<index>``.
        visible: value of ``CUDA_VISIBLE_DEVICES``; None: not set.
    """
    names = [name.strip() for name in (visible or "").split(",") if name.strip()]
    if index >= len(names):
        return index
    return int(names[index]) if names[index].isdigit() else names[index]


def gpu_handle(nvml: Any, device: str) -> Any:
    """NVML's handle of ``cuda:N``, counted in ``CUDA_VISIBLE_DEVICES`` as CUDA does.

    Raises:
        pynvml.NVMLError: there is none.
    """
    index = int(device.partition(":")[2] or 0)
    name = visible_device(index, os.environ.get("CUDA_VISIBLE_DEVICES"))
    if isinstance(name, int):
        return nvml.nvmlDeviceGetHandleByIndex(name)
    return nvml.nvmlDeviceGetHandleByUUID(name)


@dataclass(frozen=True, slots=True)
class VisibleGpu:
    """A GPU that CUDA sees."""

    device: str
    """``cuda:N``"""
    cores: frozenset[int]
    """Processor cores near it, of those this process may use."""
    free_bytes: int
    """Memory that is free now [bytes]."""


def visible_gpus() -> list[VisibleGpu]:
    """The GPUs that CUDA sees, in its order; none without a driver."""
    import pynvml

    allowed = os.sched_getaffinity(0)
    gpus = []
    # What it does not find, CUDA does not see either.
    with contextlib.suppress(pynvml.NVMLError):
        nvml = library()
        visible = os.environ.get("CUDA_VISIBLE_DEVICES")
        count = len([n for n in visible.split(",") if n.strip()]) if visible is not None else None
        if count is None:
            count = nvml.nvmlDeviceGetCount()
        for index in range(count):
            handle = gpu_handle(nvml, f"cuda:{index}")
            near = allowed & _near(nvml, handle)
            free = int(nvml.nvmlDeviceGetMemoryInfo(handle).free)
            gpus.append(VisibleGpu(f"cuda:{index}", frozenset(near or allowed), free))
    return gpus


def takes_several(device: str) -> bool:
    """Whether several processes may compute on ``cuda:N`` without a service between them."""
    import pynvml

    with contextlib.suppress(pynvml.NVMLError):
        nvml = library()
        mode = nvml.nvmlDeviceGetComputeMode(gpu_handle(nvml, device))
        return bool(mode == nvml.NVML_COMPUTEMODE_DEFAULT)
    return False


def _near(nvml: Any, handle: Any) -> set[int]:
    """Cores near a GPU; none if the driver does not tell."""
    words = -(-(os.cpu_count() or 1) // 64)
    try:
        masks = nvml.nvmlDeviceGetCpuAffinity(handle, words)
    except nvml.NVMLError:
        return set()
    return {
        64 * word + bit for word, mask in enumerate(masks) for bit in range(64) if mask >> bit & 1
    }
