"""Kernels of the shipped networks, compiled by one process and read by another."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from twin.base.gpu.compiled_kernels import VARIABLE

LOAD = """
import warp as wp
from devkit.detector.compiling import _channels
from devkit.detector.resize import resize_kernel
from devkit.detector.thin import layer_kernel
from twin.world.kernel_cache import prepare_kernels
prepare_kernels()
for kernel in (resize_kernel, *map(layer_kernel, [*_channels(), 5])):
    wp.load_module(kernel.module, device="cpu")
print(wp.config.kernel_cache_dir)
"""


@pytest.mark.slow
def test_a_process_without_a_cache_finds_compiled_kernels_and_compiles_what_is_missing(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "kernels"
    words = [sys.executable, "-m", "devkit", "kernels", "--device", "cpu", "--into", str(folder)]
    subprocess.run(words, check=True)
    assert folder.is_dir()
    compiled = {path.relative_to(folder) for path in folder.glob("*/*/*")}
    assert len(compiled) >= 3

    variables = {VARIABLE: str(folder), "WARP_CACHE_PATH": str(tmp_path / "empty")}
    done = subprocess.run(
        [sys.executable, "-c", LOAD],
        env={**os.environ, **variables},
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(done.stdout.splitlines()[-1]).parent == tmp_path / "empty"
    cache = tmp_path / "empty"
    linked = {path.relative_to(cache) for path in cache.glob("*/*/*") if path.is_symlink()}
    assert linked == compiled
    own = {path.parent.name for path in cache.glob("*/*/*") if not path.is_symlink()}
    assert len(own) == 1, "one layer that no shipped network has"
    assert not own & {path.parent.name for path in linked}


def test_a_folder_that_is_there_is_left_as_it_is(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "devkit", "kernels", "--device", "cpu", "--into", str(tmp_path)]
    subprocess.run(words, check=True)
    assert list(tmp_path.iterdir()) == []
