"""Software: the files and libraries that decide bytes, and what digests and classes say of them."""

from __future__ import annotations

from collections.abc import Mapping

from schemas.digest import digest

DECODERS = ("dracopy", "meshopt", "opengl-basisu")
"""Distributions that read compressed meshes and textures, each an option. Without the one that a
file needs the file is refused; none that ships needs one."""
RUNTIMES = ("onnxruntime", "onnxruntime-gpu")
"""Distributions that run float networks, one or none of them installed."""
TRANSLATORS = ("rosbags",)
"""Distributions that translate for stacks of somebody else, each an option."""
OPENCV = "opencv-python-headless"
"""Distribution that runs float networks on CPUs and resizes pictures for all networks; workers may
be without it."""
OPENCV_USUAL = "5.0.0.93"
"""Version of it that device classes do not name."""
GPU_LIBRARIES = ("nvidia-cudnn-cu13", "nvidia-cublas", "nvidia-cuda-runtime")
"""Distributions that onnxruntime-gpu computes with; they count beside it alone."""
_OPENCV = "~opencv-"
"""Before the version of OpenCV in a machine's class."""


def digest_of(files: Mapping[str, str], libraries: Mapping[str, str]) -> str:
    """The software digest of these parts.

    OpenCV's version is no part of it: only networks depend on it, and those of floats on the device
    class (:func:`machine_class`).

    Args:
        files: path -> SHA-256.
        libraries: name -> version.
    """
    return _digest(files, {name: v for name, v in libraries.items() if name != OPENCV})


def is_digest_of(software: str, files: Mapping[str, str], libraries: Mapping[str, str]) -> bool:
    """Whether ``software`` is the digest of these parts, or was while OpenCV was part of it."""
    return software in (digest_of(files, libraries), _digest(files, libraries))


def _digest(files: Mapping[str, str], libraries: Mapping[str, str]) -> str:
    parts = [f"{path}={sha}" for path, sha in sorted(files.items())]
    parts += [f"{name}=={version}" for name, version in sorted(libraries.items())]
    return digest([part.encode() for part in parts])


def machine_class(hardware: str, opencv: str) -> str:
    """The class of a machine, ``cpu:x86_64+avx2+fma`` or ``cpu:x86_64+avx2+fma~opencv-5.0.1.2``.

    Args:
        hardware: its device, ``cpu:<instruction set>`` or ``cuda:<device name>``.
        opencv: version of OpenCV that Python imports there, ``unknown`` if it does not say one;
            empty: none. The usual one is not named, nor none: where there is none, no network runs.
    """
    named = opencv not in ("", OPENCV_USUAL)
    return f"{hardware}{_OPENCV}{opencv}" if named else hardware


def hardware_of(machine: str) -> str:
    """The device alone of a machine's class."""
    return machine.partition(_OPENCV)[0]


def differing(
    before: Mapping[str, str], here: Mapping[str, str], spared: frozenset[str] = frozenset()
) -> list[str]:
    """Names whose values are not the same in both, sorted, without the spared ones."""
    names = (before.keys() | here.keys()) - spared
    return sorted(name for name in names if before.get(name) != here.get(name))
