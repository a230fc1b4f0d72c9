"""The first use of a GPU by a process, ahead of everything that needs it.

It takes a quarter of a second in the driver, for most of which the driver holds a lock of the whole
machine: of many processes that begin together each waits for all. Where somebody gives turns, a
process waits only for those before it, and the first ones compute while the last ones begin.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import threading
from collections.abc import Iterator

from twin.base.gpu.nvml import takes_several

TURNS_VARIABLE = "TWIN_GPU_TURNS"
"""Environment variable: path of the Unix socket of whoever gives turns; not set: nobody does."""

PLACE_VARIABLE = "TWIN_GPU_PLACE"
"""Environment variable: place of this process in the queue, from 0; the first comes first."""

PIPES_VARIABLE = "CUDA_MPS_PIPE_DIRECTORY"
"""Environment variable of CUDA: where NVIDIA's Multi-Process Service (MPS) listens."""

TURN_S = 30.0
"""Longest wait for a turn; it saves time, nothing depends on it [s]."""

_begun: dict[str, threading.Thread] = {}


def begin(device: str) -> None:
    """Have a thread begin to use ``cuda:N``; on a CPU, and once it was begun, nothing happens. Only
    from the main thread."""
    if device.startswith("cuda:") and device not in _begun:
        thread = threading.Thread(target=_use, args=(device,), name="gpu", daemon=True)
        _begun[device] = thread
        thread.start()


def begun(device: str) -> None:
    """Wait until what :func:`begin` began is done; whoever uses the GPU says what is wrong."""
    if device in _begun:
        _begun[device].join()


def apart(device: str) -> dict[str, str]:
    """Environment of a process that computes on ``device`` by itself: what MPS serves together ends
    together when one of them writes where it must not.

    Empty on a CPU, and where the GPU takes nobody but the service.
    """
    if not device.startswith("cuda:") or not takes_several(device):
        return {}
    return {PIPES_VARIABLE: "/nonexistent"}


def _use(device: str) -> None:
    """Make the context that all libraries of a process share; it lasts as long as the process."""
    with contextlib.suppress(OSError, ValueError):
        driver = ctypes.CDLL("libcuda.so.1")
        number = int(device.removeprefix("cuda:"))
        handle, context = ctypes.c_int(), ctypes.c_void_p()
        with _turn():
            if not driver.cuInit(0) and not driver.cuDeviceGet(ctypes.byref(handle), number):
                driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), handle)


@contextlib.contextmanager
def _turn() -> Iterator[None]:
    path = os.environ.get(TURNS_VARIABLE, "")
    if not path:
        yield
        return
    with socket.socket(socket.AF_UNIX) as queue:
        queue.settimeout(TURN_S)
        with contextlib.suppress(OSError):  # it is gone, or takes too long
            queue.connect(path)
            queue.sendall(os.environ.get(PLACE_VARIABLE, "0").encode() + b"\n")
            queue.recv(1)
        yield
