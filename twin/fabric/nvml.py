"""Which GPU a device name means, as NVML knows it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any


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
    try:
        pynvml.nvmlInit()
    except pynvml.NVMLError:
        return []
    found = []
    try:
        visible = os.environ.get("CUDA_VISIBLE_DEVICES")
        count = len([n for n in visible.split(",") if n.strip()]) if visible is not None else None
        if count is None:
            count = pynvml.nvmlDeviceGetCount()
        for index in range(count):
            handle = gpu_handle(pynvml, f"cuda:{index}")
            near = allowed & _near(pynvml, handle)
            free = int(pynvml.nvmlDeviceGetMemoryInfo(handle).free)
            found.append(VisibleGpu(f"cuda:{index}", frozenset(near or allowed), free))
    except pynvml.NVMLError:
        pass  # what CUDA does not see either
    finally:
        pynvml.nvmlShutdown()
    return found


def takes_several(device: str) -> bool:
    """Whether several processes may compute on ``cuda:N`` without a service between them."""
    import pynvml

    try:
        pynvml.nvmlInit()
    except pynvml.NVMLError:
        return False
    try:
        mode = pynvml.nvmlDeviceGetComputeMode(gpu_handle(pynvml, device))
    except pynvml.NVMLError:
        return False
    finally:
        pynvml.nvmlShutdown()
    return bool(mode == pynvml.NVML_COMPUTEMODE_DEFAULT)


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
