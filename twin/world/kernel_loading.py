"""Kernels are compiled side by side, and each by one process only.

Workers of a machine begin together and want the same kernels. Whoever finds one being compiled goes
on with the next, and loads it from the cache at last.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import ModuleType
from urllib.parse import quote

import warp as wp

THREADS_MAX = 4
"""Most modules that a process compiles at a time: each takes some hundred megabytes."""
PATIENCE_S = 120.0
"""A module that another process compiles for longer is compiled here, too [s]."""
_LOOKS_S = 0.02

Wanted = ModuleType | wp.Kernel | tuple[ModuleType | wp.Kernel, int]
"""A Python module with kernels, or a kernel with a module of its own; with the threads of its
blocks on a GPU, if they are not Warp's usual ones."""


def load_kernels(device: wp.Device, wanted: Sequence[Wanted]) -> None:
    """Compile what is not in the kernel cache, and load all: now, and not in the middle of a case.

    :func:`twin.world.kernel_cache.prepare_kernels` must have run.
    """
    modules = list(dict.fromkeys(_module_of(each) for each in wanted))
    threads = min(THREADS_MAX, len(os.sched_getaffinity(0)), len(modules))
    with ThreadPoolExecutor(threads) as pool:
        done = list(pool.map(partial(_load, device, patience_s=0.0), modules))
        late = [module for module, loaded in zip(modules, done, strict=True) if not loaded]
        list(pool.map(partial(_load, device, patience_s=PATIENCE_S), late))


def _module_of(wanted: Wanted) -> tuple[wp.Module, int | None]:
    """The module as Warp has it, and the threads of its blocks."""
    what, block = wanted if isinstance(wanted, tuple) else (wanted, None)
    return (wp.get_module(what.__name__) if isinstance(what, ModuleType) else what.module), block


def _load(device: wp.Device, module: tuple[wp.Module, int | None], *, patience_s: float) -> bool:
    """Load a module; whether it is: not if another process holds it for longer than one waits for
    at all."""
    which, block = module
    with _held(which.name, patience_s) as held:
        if held or patience_s:
            wp.force_load(device, [which], block_dim=block)
    return held or patience_s > 0.0


@contextlib.contextmanager
def _held(name: str, patience_s: float) -> Iterator[bool]:
    """Keep other processes of this cache from compiling a module meanwhile; whether it could be
    done in time. Where a cache knows no locks nobody waits for anybody."""
    folder = Path(wp.config.kernel_cache_dir) / "locks"
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(exist_ok=True)
            lock = os.open(folder / quote(name, safe=""), os.O_RDWR | os.O_CREAT, 0o600)
            stack.callback(os.close, lock)
            held = _locked(lock, patience_s)
        except OSError:
            held = True
        yield held


def _locked(lock: int, patience_s: float) -> bool:
    """Whether a lock is ours before patience ends."""
    until_s = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= until_s:
                return False
            time.sleep(_LOOKS_S)
        else:
            return True
