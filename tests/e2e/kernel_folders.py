"""Folders of compiled kernels, filled before: compiling all of them takes a minute and a half."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import warp as wp

from twin.world.kernel_cache import prepare_kernels

LEFT_OUT = "wp_twin.sensors.camera.boxes_"
"""The module that :func:`all_but_one` leaves to be compiled."""
_FEATURES = "echo $(uname -m)-$(grep -E -m 1 '^(flags|Features)' /proc/cpuinfo | cksum)"


def compiled_before() -> Path:
    """Where the tests' own processes keep compiled kernels."""
    prepare_kernels()
    return Path(wp.config.kernel_cache_dir)


def all_but_one(folder: Path) -> Path:
    """Fill ``folder`` with links to the kernels, except one module; Warp's place in it."""
    place = folder / wp.config.version
    place.mkdir(parents=True)
    for path in compiled_before().iterdir():
        if not path.name.startswith(LEFT_OUT):
            (place / path.name).symlink_to(path)
    return place


def compiled_in(place: Path) -> list[str]:
    """The modules in it that are no links, without those that somebody is writing."""
    own = [path.name for path in place.iterdir() if not path.is_symlink()]
    return [name for name in own if name.startswith("wp_") and not re.search(r"_p\d+_t\d+$", name)]


def for_jobs(folder: Path) -> Path:
    """Make ``folder`` a place where jobs find the kernels: those of scripts that ``hpc`` has
    written, below a name of the processor, and those that are typed by hand."""
    folder.mkdir()
    source = compiled_before()
    (folder / source.name).symlink_to(source)
    (folder / of_this_processor()).symlink_to(source.parent)
    return folder


def of_this_processor() -> str:
    """What job scripts call the processor."""
    done = subprocess.run(["bash", "-c", _FEATURES], capture_output=True, text=True, check=True)
    return done.stdout.split()[0]
