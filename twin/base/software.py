"""What software and which device produced a result."""

from __future__ import annotations

import errno
import functools
import hashlib
import importlib.util
import os
import re
import stat
import sys
import time
from pathlib import Path

from schemas.files.software import (
    DECODERS,
    GPU_LIBRARIES,
    OPENCV,
    RUNTIMES,
    TRANSLATORS,
    digest_of,
    machine_class,
)
from schemas.kinds.installed import version_of
from schemas.kinds.registry import OUR_DISTRIBUTIONS
from twin.base.errors import UsageError
from twin.base.gpu.nvml import gpu_handle, library

_PACKAGES = ("schemas", "twin", "devkit")
_BESIDE = ("conductor", "viewer", "hpc", "drivetwin")
ALL_PACKAGES = (*_PACKAGES, *_BESIDE)
"""Ours; those beside the first three may not be installed."""
_LIBRARIES = (
    *("numpy", "warp-lang", OPENCV, "pillow", "trimesh"),
    *(*DECODERS, *RUNTIMES),
    *("onnx", "lark", *TRANSLATORS),
)
_SUFFIXES = (".py", ".yaml", ".xodr", ".cfg", ".names", ".onnx", ".integer", ".msg")


def software_digest() -> str:
    """SHA-256 over the sorted (path, SHA-256) of the installed ``schemas``, ``twin`` and ``devkit``
    files and the exact versions of the libraries that reach the KPI values of every case."""
    return digest_of(software_files(), library_versions())


def own_version() -> str:
    """Version of this project, whichever of its distributions is installed; empty beside a source
    tree that is not."""
    return next(filter(None, map(version_of, OUR_DISTRIBUTIONS)), "")


def software_files() -> dict[str, str]:
    """Path, as in ``twin/cli.py`` -> SHA-256 of every file of ours that counts, sorted."""
    files, chunk = {}, memoryview(bytearray(_CHUNK_BYTES))
    for package in _PACKAGES:
        root = str(package_folder(package))
        for folder, _, names in os.walk(root):
            for name in names:
                if not name.endswith(_SUFFIXES) or name in _SUFFIXES:
                    continue
                path = f"{folder}/{name}"
                if sha256 := _sha256(path, chunk):
                    files[package + path[len(root) :]] = sha256
    return dict(sorted(files.items()))


_known: dict[str, tuple[tuple[int, ...], str]] = {}
"""Path -> what the system said of a file when it was read, and its SHA-256. Processes ask for the
digest several times, and hundreds of files have not changed since."""
_SETTLED_NS = 2_000_000_000
"""What changed less than so long ago may change again and keep its time [ns], in whose steps some
file systems count: it is read each time."""
_CHUNK_BYTES = 1 << 17
"""Read at once: memory for whole files is new each time, and takes longer than what is done with
it [bytes]."""
_NO_FILE = {errno.ENOENT, errno.ELOOP, errno.ENXIO}
"""A link that leads nowhere or to itself, a socket."""


def _sha256(path: str, chunk: memoryview) -> str:
    """SHA-256 of a file, read through ``chunk``; empty: it is none, but a folder, a pipe, a
    socket or a link to nothing."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError as error:
        if error.errno in _NO_FILE:
            return ""
        raise
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            return ""
        mark = status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino, status.st_dev
        settled = time.time_ns() - status.st_ctime_ns > _SETTLED_NS
        if settled and path in _known and _known[path][0] == mark:
            return _known[path][1]
        whole = hashlib.sha256()
        while count := os.readv(descriptor, [chunk]):
            whole.update(chunk[:count])
        sha256 = whole.hexdigest()
        if settled:
            _known[path] = mark, sha256
        return sha256
    finally:
        os.close(descriptor)


def library_versions() -> dict[str, str]:
    """Versions of the libraries that reach a KPI, as far as they are installed, sorted; and of
    Python, whose ``sum`` of floats is another one from 3.12 on."""
    versions = {name: version for name in _LIBRARIES if (version := version_of(name))}
    versions["python"] = f"{sys.version_info.major}.{sys.version_info.minor}"
    if "onnxruntime-gpu" in versions:
        versions |= {name: version for name in GPU_LIBRARIES if (version := version_of(name))}
    return dict(sorted(versions.items()))


def check_packages() -> None:
    """Refuse a foreign ``schemas`` or ``devkit`` package that hides ours (both exist on PyPI).

    Raises:
        UsageError: names the foreign package's folder.
    """
    home = Path(__file__).resolve().parents[2]
    for package in ALL_PACKAGES:
        if package in _BESIDE and not (home / package).is_dir():
            continue  # the distribution of workers is without it
        folder = package_folder(package)
        if folder != home / package:
            raise UsageError(
                f"package '{package}' is loaded from {folder}, expected {home / package}; "
                "uninstall the other one or take it off PYTHONPATH"
            )


_REPORTS = (*_BESIDE, "plotly", "jinja2", "matplotlib", "prometheus_client", "pyarrow", "rerun")
"""Packages that the distribution of workers is without."""


def missing_package(error: ModuleNotFoundError) -> str:
    """What to install, where a package is missing that the distribution of workers is without;
    empty: it is another one, which is a mistake of ours."""
    package = (error.name or "").partition(".")[0]
    if package == "cv2":
        return (
            "this needs the package cv2, which the distribution drivetwin-worker has as an "
            "option: pip install 'drivetwin-worker[networks]'"
        )
    if package not in _REPORTS:
        return ""
    return (
        f"this needs the package {package}, which is not part of the distribution "
        f"drivetwin-worker; `pip uninstall drivetwin-worker`, then `pip install drivetwin`"
    )


def own_folders() -> list[Path]:
    """Folders of our packages that are installed: each process looks whether it has the right
    ones."""
    home = Path(__file__).resolve().parents[2]
    return [home / package for package in ALL_PACKAGES if (home / package).is_dir()]


def package_folder(package: str) -> Path:
    """Where a package of ours is installed, found without importing it.

    Raises:
        UsageError: it is not.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise UsageError(f"package '{package}' is not installed; install drivetwin again")
    return Path(next(iter(spec.submodule_search_locations))).resolve()


def device_class(device: str) -> str:
    """``cpu:x86_64+avx2+fma`` or ``cuda:<device name>``: results are bit-equal within a class.

    Behind it stands the version of OpenCV, if one is installed that is not the usual one.

    Raises:
        UsageError: no such device here.
    """
    return machine_class(hardware_class(device), opencv_version())


_OPENCV_VERSION = re.compile(r'^opencv_version = "([0-9A-Za-z.+-]{1,40})"', re.MULTILINE)


def opencv_version() -> str:
    """Version of the OpenCV that Python imports here, whichever of its distributions brought it
    (several own the same folder); empty: there is none."""
    spec = importlib.util.find_spec("cv2")
    if spec is None:
        return ""
    for folder in spec.submodule_search_locations or ():
        try:
            text = (Path(folder) / "version.py").read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        if found := _OPENCV_VERSION.search(text):
            return found[1]
    return "unknown"  # built by somebody else


def hardware_class(device: str) -> str:
    """The part of the device class that the device decides.

    A GPU whose host has another processor than that is ``cuda:<device name>@<instruction set>``.

    Raises:
        UsageError: no such device here.
    """
    if device == "cpu":
        return f"cpu:{_instruction_set()}"
    if not re.fullmatch(r"cuda:[0-9]{1,3}", device):
        raise UsageError(f"device '{device[:40]}': allowed are cpu and cuda:N, e.g. cuda:0")
    host = _instruction_set()
    return f"cuda:{_gpu_name(device)}" + (f"@{host}" if host != _USUAL_HOST else "")


_USUAL_HOST = "x86_64+avx2+fma"


@functools.cache  # the driver keeps others waiting while processes begin to use GPUs
def _gpu_name(device: str) -> str:
    import pynvml

    try:
        nvml = library()
        name: str = nvml.nvmlDeviceGetName(gpu_handle(nvml, device))
    except pynvml.NVMLError as error:
        raise UsageError(f"device '{device}': not here ({error}); use --device cpu") from None
    return name


def _instruction_set() -> str:
    """cv2.dnn is bit-equal on AVX2 and AVX-512 but not without FMA; other CPUs are their own."""
    import platform

    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.machine()
    flags = next((line for line in text.splitlines() if line.startswith("flags")), "").split()
    features = [name for name in ("avx2", "fma") if name in flags]
    return "+".join([platform.machine(), *features])
