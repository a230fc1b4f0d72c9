"""Gathers the facts of ``conductor doctor``. What it writes it removes."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import importlib.metadata
import json
import os
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from conductor.doctor.judging import MachineFacts, Package, WarpCuda
from schemas.kinds.batch_system import batch_systems
from schemas.kinds.registry import OUR_DISTRIBUTION, OUR_DISTRIBUTIONS
from twin.base.cache import cache_folder, check_cache
from twin.base.errors import UsageError
from twin.base.files import filesystem, nearest_existing
from twin.base.gpu.nvml import library, visible_gpus
from twin.base.gpu.vulkan import has_vulkan
from twin.base.software import hardware_class
from twin.sandbox.possible import why_not

WARP_S = 120.0
"""Longest time that Warp may take to start in a child process [s]."""
TIME_ERROR = 5
"""What ``adjtimex`` returns where the clock is not synchronised."""
LOCK_FILE = "constraints.txt"


def look_at_machine(out: Path, port: int) -> MachineFacts:
    """Everything about this machine.

    Args:
        out: where runs would be kept; what is missing of it is not made.
        port: of the conductor, on all interfaces.
    """
    folder = nearest_existing(out.absolute())
    gpus, driver, trouble = _gpus()
    return MachineFacts(
        python=sys.version_info[:3],
        distributions=installed_distributions(),
        packages=declared_packages(),
        processor=hardware_class("cpu"),
        gpus=gpus,
        driver=driver,
        driver_trouble=trouble,
        warp=_warp(),
        vulkan=has_vulkan(),
        sandbox=why_not(),
        port=port,
        port_trouble=port_trouble(port),
        folder=str(folder),
        filesystem=filesystem(folder),
        folder_trouble=folder_trouble(folder),
        free_bytes=shutil.disk_usage(folder).free,
        cache_trouble=_cache_trouble(),
        memory_bytes=memory_bytes(),
        files_max=resource.getrlimit(resource.RLIMIT_NOFILE)[1],
        clock_year=time.gmtime().tm_year,
        clock_synchronised=_synchronised(),
        browser=shutil.which("chromium") or "",
        schedulers=tuple(
            kind.title
            for kind in batch_systems().declared
            if kind.submits and shutil.which(kind.submits)
        ),
    )


def installed_distributions() -> tuple[str, ...]:
    """Distributions of ours that are installed."""
    return tuple(
        name for name in OUR_DISTRIBUTIONS if any(importlib.metadata.distributions(name=name))
    )


def declared_packages(distribution: str = OUR_DISTRIBUTION) -> tuple[Package, ...]:
    """The libraries that a distribution declares without an extra, as they are installed; none
    beside a source tree that is not installed."""
    try:
        lines = importlib.metadata.requires(distribution) or []
    except importlib.metadata.PackageNotFoundError:
        return ()
    pinned = _pinned()
    packages = []
    for requirement in map(Requirement, lines):
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found = importlib.metadata.version(requirement.name)
        except importlib.metadata.PackageNotFoundError:
            found = ""
        packages.append(
            Package(
                name=requirement.name,
                wanted=str(requirement.specifier),
                found=found,
                fits=bool(found) and requirement.specifier.contains(found, prereleases=True),
                pinned=pinned.get(canonicalize_name(requirement.name), ""),
            )
        )
    return tuple(packages)


def _pinned() -> dict[str, str]:
    """Versions of the lock file beside our sources, by normalised name; none for an installed
    wheel."""
    path = Path(__file__).parents[2] / LOCK_FILE
    if not path.is_file():
        return {}
    parts = (line.partition("==") for line in path.read_text(encoding="utf-8").splitlines())
    return {canonicalize_name(name): version for name, _, version in parts if version}


def _gpus() -> tuple[tuple[str, ...], str, str]:
    """Names of the GPUs that CUDA sees, the driver's version, and what is wrong with it."""
    import pynvml

    try:
        nvml = library()
        driver = str(nvml.nvmlSystemGetDriverVersion())
    except pynvml.NVMLError as error:
        missing = isinstance(error, pynvml.NVMLError_LibraryNotFound)
        here = any(Path("/dev").glob("nvidia[0-9]*"))
        if missing and not here:
            return (), "", ""
        return (), "", f"the NVIDIA driver does not answer: {error}"
    seen = visible_gpus()
    names = [hardware_class(gpu.device).removeprefix("cuda:").partition("@")[0] for gpu in seen]
    return tuple(names), driver, ""


def _warp() -> WarpCuda:
    words = [sys.executable, "-m", "twin.world.warp_devices"]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=WARP_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return WarpCuda(trouble=f"it does not start: {str(error)[:200]}")
    if done.returncode:
        said = done.stderr.strip().splitlines()
        return WarpCuda(trouble=said[-1][:200] if said else f"exit code {done.returncode}")
    found = json.loads(done.stdout.splitlines()[-1])
    return WarpCuda(found["toolkit"], found["driver"], tuple(found["devices"]))


def port_trouble(port: int) -> str:
    """Why nobody can listen at a port on all interfaces; empty: one can."""
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("", port))
            probe.listen()
    except OSError as error:
        return f"{port}: {error.strerror or error}"
    return ""


def folder_trouble(folder: Path) -> str:
    """Why no file can be written, synced and locked in a folder; empty: it can."""
    try:
        with tempfile.NamedTemporaryFile(prefix=".doctor-", dir=folder) as file:
            file.write(bytes(1 << 16))
            file.flush()
            os.fsync(file.fileno())
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return ""


def memory_bytes(group: Path = Path("/sys/fs/cgroup")) -> int:
    """Memory that this process may use now: what is available, or what its control group leaves,
    if that is less. Pages of files that the group could drop count as free [bytes]."""
    free = psutil.virtual_memory().available
    with contextlib.suppress(OSError, ValueError):
        most = int((group / "memory.max").read_text())
        used = int((group / "memory.current").read_text())
        lines = (group / "memory.stat").read_text().splitlines()
        dropped = sum(int(n) for name, n in map(str.split, lines) if name == "inactive_file")
        free = min(free, max(0, most - used + dropped))
    return free


def _cache_trouble() -> str:
    try:
        check_cache(cache_folder())
    except UsageError as error:
        return str(error)
    except OSError as error:
        return f"{error.filename}: {error.strerror}"
    return ""


def _synchronised() -> bool | None:
    """Whether the kernel's clock is kept by a time service; None: it does not tell."""
    libc = ctypes.CDLL(None, use_errno=True)
    state = libc.adjtimex(ctypes.create_string_buffer(512))  # all zero: asks, sets nothing
    return None if state < 0 else state != TIME_ERROR
