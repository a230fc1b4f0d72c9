"""What software and which device produced a result."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import re
from pathlib import Path

from schemas.digest import digest
from twin.base.errors import UsageError
from twin.base.gpu.nvml import gpu_handle, library

_PACKAGES = ("schemas", "twin", "devkit")
_LIBRARIES = (
    *("numpy", "warp-lang", "opencv-python-headless", "pillow", "trimesh"),
    *("dracopy", "meshopt", "opengl-basisu"),
    *("onnx", "onnxruntime", "onnxruntime-gpu", "lark", "rosbags"),
)
_GPU_LIBRARIES = ("nvidia-cudnn-cu13", "nvidia-cublas", "nvidia-cuda-runtime")
"""Count where onnxruntime-gpu, which computes with them, is installed."""
_SUFFIXES = {".py", ".yaml", ".xodr", ".cfg", ".names", ".onnx", ".integer", ".msg"}


def software_digest() -> str:
    """SHA-256 over the sorted (path, SHA-256) of the installed ``schemas``, ``twin`` and ``devkit``
    files and the exact versions of the libraries that reach a KPI."""
    parts: list[bytes] = []
    for package in _PACKAGES:
        root = package_folder(package)
        for path in sorted(p for p in root.rglob("*") if p.suffix in _SUFFIXES and p.is_file()):
            name = f"{package}/{path.relative_to(root).as_posix()}"
            parts.append(f"{name}={hashlib.sha256(path.read_bytes()).hexdigest()}".encode())
    parts += [f"{name}=={version}".encode() for name, version in library_versions().items()]
    return digest(parts)


def library_versions() -> dict[str, str]:
    """Versions of the libraries that reach a KPI, as far as they are installed."""
    versions = {name: version for name in _LIBRARIES if (version := _version(name))}
    if "onnxruntime-gpu" in versions:
        versions |= {name: version for name in _GPU_LIBRARIES if (version := _version(name))}
    return versions


def _version(library: str) -> str:
    """Empty if it is not installed."""
    import importlib.metadata  # takes 10 ms, and every command loads this module

    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return ""


def check_packages() -> None:
    """Refuse a foreign ``schemas`` or ``devkit`` package that hides ours (both exist on PyPI).

    Raises:
        UsageError: names the foreign package's folder.
    """
    home = Path(__file__).resolve().parents[2]
    for package in ("schemas", "twin", "devkit", "conductor", "viewer", "hpc"):
        folder = package_folder(package)
        if folder != home / package:
            raise UsageError(
                f"package '{package}' is loaded from {folder}, expected {home / package}; "
                "uninstall the other one or take it off PYTHONPATH"
            )


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
