"""Compiles what the shipped networks need; see :mod:`twin.base.gpu.compiled_kernels`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import onnx
import warp as wp

from devkit.detector.integer.convolution import convolution_kernel
from devkit.detector.integer.map_kernels import picture_kernel
from devkit.detector.model_files import shipped_models
from devkit.detector.resize import prepare_kernels, resize_kernel
from devkit.detector.stem import cut
from devkit.detector.thin import layer_kernel


def compile_kernels(device: str, folder: Path) -> None:
    """Compile for ``device`` into ``folder``, which is there at once with everything or not at all.

    Raises:
        OSError: it cannot be written.
    """
    if folder.is_dir():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    begun = Path(tempfile.mkdtemp(prefix=".", dir=folder.parent))
    try:
        wp.config.kernel_cache_dir = str(begun)
        prepare_kernels()
        integer = convolution_kernel, picture_kernel
        for kernel in (resize_kernel, *integer, *map(layer_kernel, _channels())):
            wp.load_module(kernel.module, device=device)
        begun.chmod(0o755)
        if not folder.is_dir():  # another worker may have been faster
            begun.rename(folder)
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _channels() -> list[int]:
    """Channels out of the first layers of all shipped networks."""
    counts: set[int] = set()
    for path in shipped_models().values():
        model = onnx.load(path)
        layers, _, _ = cut(model, model.graph.input[0].name)
        counts.update(len(layer.biases) for layer in layers)
    return sorted(counts)
