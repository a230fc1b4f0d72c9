"""Software: the files and libraries that decide bytes, and their digest."""

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
GPU_LIBRARIES = ("nvidia-cudnn-cu13", "nvidia-cublas", "nvidia-cuda-runtime")
"""Distributions that onnxruntime-gpu computes with; they count beside it alone."""


def digest_of(files: Mapping[str, str], libraries: Mapping[str, str]) -> str:
    """The software digest of these parts.

    Args:
        files: path -> SHA-256.
        libraries: name -> version.
    """
    parts = [f"{path}={sha}" for path, sha in sorted(files.items())]
    parts += [f"{name}=={version}" for name, version in sorted(libraries.items())]
    return digest([part.encode() for part in parts])


def differing(
    before: Mapping[str, str], here: Mapping[str, str], spared: frozenset[str] = frozenset()
) -> list[str]:
    """Names whose values are not the same in both, sorted, without the spared ones."""
    names = (before.keys() | here.keys()) - spared
    return sorted(name for name in names if before.get(name) != here.get(name))
