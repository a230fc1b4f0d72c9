"""GPU memory that two processes share, by handles of CUDA's inter-process communication.

The only part of the fabric that needs Warp, and only where a GPU is: whoever imports this module
has not loaded it yet.
"""

from __future__ import annotations

import ctypes
import importlib
import secrets
import threading
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PROBE_BYTES = 64


class SharedProbe:
    """A few bytes in a GPU's memory that prove to another process that it sees the same GPU."""

    def __init__(self, device: str) -> None:
        """Allocate them on ``cuda:N``.

        Raises:
            RuntimeError: the GPU or its driver cannot share memory.
        """
        warp = _warp()
        self.nonce = secrets.token_hex(16)
        data = np.zeros(_PROBE_BYTES, np.uint8)
        data[: len(self.nonce)] = np.frombuffer(self.nonce.encode(), np.uint8)
        with warp.ScopedMempool(device, False):
            self._array = warp.zeros(_PROBE_BYTES, dtype=warp.uint8, device=device)
        self._array.assign(data)
        warp.synchronize_device(device)
        self.handle = handle_of(self._array)


def offer(device: str) -> SharedProbe | None:
    """A probe on ``device``; None where memory cannot be shared: a CPU, some virtual machines."""
    if not device.startswith("cuda"):
        return None
    try:
        return SharedProbe(device)
    except RuntimeError:
        return None


def proves(handle: bytes, nonce: str, device: str) -> bool:
    """Whether ``handle`` opens here and holds the other side's ``nonce``."""
    try:
        array = DeviceMemory(handle, "|u1", [_PROBE_BYTES], device).frame().host()
    except Exception:  # of the driver, of Warp, or Warp is not here: frames travel another way
        return False
    return array[: len(nonce)].tobytes() == nonce.encode()


def handle_of(array: Any) -> bytes:
    """The handle of a Warp array that was allocated outside the memory pool.

    Raises:
        RuntimeError: it has none.
    """
    return bytes(array.ipc_handle())


class DeviceMemory:
    """An array of another process, opened by its handle; it stays open until this is freed."""

    def __init__(self, handle: bytes, dtype: str, shape: Sequence[int], device: str) -> None:
        """Open the array.

        Raises:
            RuntimeError: the handle cannot be opened here.
        """
        warp = _warp()
        self.shape = tuple(shape)
        self.dtype = np.dtype(dtype)
        kind = warp.dtype_from_numpy(self.dtype)
        self.array = warp.from_ipc_handle(handle, kind, self.shape, device=device)
        if not self.array.ptr:
            raise RuntimeError(f"memory of {device} cannot be opened by its handle")
        self._staging: Any = None
        self._copying = threading.Lock()

    def frame(self) -> DeviceFrame:
        """The frame that lies in the buffer now."""
        return DeviceFrame(self)

    def copied(self) -> NDArray[Any]:
        """All of it in this host's memory, in one buffer that is used again."""
        warp = _warp()
        with self._copying:
            if self._staging is None:
                kind = self.array.dtype
                self._staging = warp.empty(self.shape, dtype=kind, device="cpu", pinned=True)
            warp.copy(self._staging, self.array)
            warp.synchronize_stream(self.array.device.stream)
        host: NDArray[Any] = self._staging.numpy()
        return host


class DeviceFrame:
    """The values of one ``seq`` in a GPU's memory; valid until it is answered."""

    def __init__(self, memory: DeviceMemory) -> None:
        self._memory = memory
        self._host: NDArray[Any] | None = None
        self.shape = memory.shape
        self.dtype = memory.dtype

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        interface: dict[str, Any] = self._memory.array.__cuda_array_interface__
        return interface

    def host(self) -> NDArray[Any]:
        """The values in this host's memory: copied when first asked for, all at once."""
        if self._host is None:
            self._host = self._memory.copied()
        return self._host


def pin(host: NDArray[Any], context: Any) -> object | None:
    """Pin the pages of an array, so that a GPU copies to it at full speed, until the answer is
    freed; None: it cannot be done, and copies are slower.

    Args:
        host: the array.
        context: CUDA context of the GPU, as Warp's devices hold it.
    """
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return None
    context = context if isinstance(context, ctypes.c_void_p) else ctypes.c_void_p(context)
    if driver.cuCtxPushCurrent_v2(context) != 0:
        return None
    address = ctypes.c_void_p(host.ctypes.data)
    size, portable = ctypes.c_size_t(host.nbytes), ctypes.c_uint(1)
    refused = driver.cuMemHostRegister_v2(address, size, portable)
    driver.cuCtxPopCurrent_v2(ctypes.byref(ctypes.c_void_p()))
    if refused:
        return None
    pinned = _Pinned()
    # The array is kept alive by the callback: pages must not be freed while they are pinned.
    weakref.finalize(pinned, _unpin, driver, address, host).atexit = False
    return pinned


class _Pinned:
    """Stands for pinned pages."""


def _unpin(driver: Any, address: ctypes.c_void_p, _host: NDArray[Any]) -> None:
    driver.cuMemHostUnregister(address)


def prepare() -> None:
    """Load what device handles need, before the first of them comes."""
    _warp().init()


def _warp() -> Any:
    # By name: viewers, conductors and stacks on a CPU must start without it.
    warp = importlib.import_module("warp")
    warp.config.quiet = True
    warp.config.log_level = warp.LOG_ERROR
    return warp
