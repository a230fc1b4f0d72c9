"""Which GPU a device name means, as NVML knows it."""

from __future__ import annotations

import os
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
