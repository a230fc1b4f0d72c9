"""Folder of compiled kernels; one of the user in /tmp when the usual one is read-only."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import os
import shutil
import stat
import sys
import tempfile
from pathlib import Path

import warp as wp

from twin.base.gpu.compiled_kernels import link_compiled
from twin.world.kernel_headers import keep_headers


def prepare_kernels() -> None:
    """Start Warp quietly with a kernel cache that can be written; repeated calls do nothing.

    ``WARP_CACHE_PATH`` and Warp's default are respected. Where neither can be written, a cache of
    this user below the temporary folder takes their place and one line on stderr says so. It is
    kept for the next run: a folder per process would be left behind by a process that is killed.
    """
    wp.config.quiet = True
    wp.config.log_level = wp.LOG_ERROR  # a machine without a GPU is nothing to warn about
    folder = _usual()
    if _writable(folder):
        _init()
        link_compiled(Path(wp.config.kernel_cache_dir))
        return
    fallback = _fallback()
    # Before wp.init(): it creates the folder and fails where it cannot.
    wp.config.kernel_cache_dir = str(fallback)
    _init()
    print(
        f"kernel cache {folder} cannot be written; using {fallback} "
        "(set WARP_CACHE_PATH to choose another)",
        file=sys.stderr,
    )


NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"
"""Part of the line that Warp writes where there is no GPU, whatever its log level."""


@functools.cache
def _init() -> None:
    """Once per process: Warp, and where it puts its headers."""
    _start_warp()
    keep_headers()


def _start_warp() -> None:
    """Start Warp; where there is no driver, without the line that says so.

    A machine without a GPU is nothing to warn about: whoever asks for one there is told. Everything
    else that is written meanwhile is passed on.
    """
    if _has_driver():
        wp.init()
        return
    sys.stderr.flush()
    before, held = os.dup(2), os.memfd_create("stderr")
    os.dup2(held, 2)
    try:
        wp.init()
    finally:
        sys.stderr.flush()
        os.dup2(before, 2)
        written = os.pread(held, os.fstat(held).st_size, 0)
        lines = written.splitlines(keepends=True)
        os.write(2, b"".join(line for line in lines if NO_DRIVER not in line))
        os.close(before)
        os.close(held)


def _has_driver() -> bool:
    """Whether Warp will find one, as it looks for it."""
    for name in ("libcuda.so", "libcuda.so.1"):
        with contextlib.suppress(OSError):
            ctypes.CDLL(name)
            return True
    return False


def wake(device: str) -> None:
    """:func:`prepare_kernels`, and begin to use a device. On ``cuda:N`` this takes half a second in
    which the driver leaves the interpreter to other threads."""
    prepare_kernels()
    _ = wp.get_device(device).context


def kept_folder(name: str) -> Path:
    """A folder beside the compiled kernels for what else is worked out once; it need not exist.

    :func:`prepare_kernels` must have run.
    """
    return Path(wp.config.kernel_cache_dir) / name


def _usual() -> Path:
    """The folder that Warp takes by itself, or the one below which it makes its own."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH") or cache)


def _fallback() -> Path:
    """Compiled code is loaded from here, so the folder must be ours and closed to others."""
    folder = Path(tempfile.gettempdir()) / f"drivetwin-kernels-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        found = None
    if (
        found is not None
        and stat.S_ISDIR(found.st_mode)
        and found.st_uid == os.getuid()
        and not found.st_mode & 0o077
    ):
        return folder
    own = tempfile.mkdtemp(prefix="drivetwin-kernels-")
    atexit.register(shutil.rmtree, own, ignore_errors=True)
    return Path(own)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def known_device(name: str) -> wp.Device:
    """A device of Warp by its name.

    Raises:
        ValueError: there is no such device here; one line.
    """
    try:
        return wp.get_device(name)
    except Exception as error:
        known = ", ".join(str(device) for device in wp.get_devices())
        raise ValueError(f"device '{name}': not here; allowed: {known}") from error
