"""One GPU's counters through NVML; where that is absent, nothing is known, which is never 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from twin.base.gpu.nvml import gpu_handle, library

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class GpuReading:
    """What the GPU's counters say; None: they do not say it."""

    uuid: str | None = None
    name: str | None = None
    percent: float | None = None
    memory_bytes: int | None = None
    memory_total_bytes: int | None = None
    power_w: float | None = None


class Gpu:
    """The GPU behind a device name such as ``cuda:0``.

    Args:
        device: ``cuda:N`` counts in ``CUDA_VISIBLE_DEVICES``, as CUDA does; anything else is no
            GPU.
    """

    def __init__(self, device: str) -> None:
        self._nvml: Any = None
        self._handle: Any = None
        if not device.startswith("cuda"):
            return
        import pynvml

        try:
            self._nvml = library()
        except pynvml.NVMLError:
            return
        self._handle = self._ask(lambda: gpu_handle(self._nvml, device))

    def read(self) -> GpuReading:
        """The counters; each is None where the GPU or its driver does not tell it."""
        nvml, handle = self._nvml, self._handle
        if handle is None:
            return GpuReading()
        memory = self._ask(lambda: nvml.nvmlDeviceGetMemoryInfo(handle))
        rates = self._ask(lambda: nvml.nvmlDeviceGetUtilizationRates(handle))
        power_mw = self._ask(lambda: nvml.nvmlDeviceGetPowerUsage(handle))
        return GpuReading(
            uuid=self._ask(lambda: _text(nvml.nvmlDeviceGetUUID(handle))),
            name=self._ask(lambda: _text(nvml.nvmlDeviceGetName(handle))),
            percent=None if rates is None else float(rates.gpu),
            memory_bytes=None if memory is None else int(memory.used),
            memory_total_bytes=None if memory is None else int(memory.total),
            power_w=None if power_mw is None else power_mw / 1000,
        )

    def _ask(self, question: Callable[[], T]) -> T | None:
        try:
            return question()
        except self._nvml.NVMLError:
            return None  # not supported by this GPU, a MIG slice, or not permitted


def _text(value: str | bytes) -> str:
    return value.decode() if isinstance(value, bytes) else value
