"""Where kernels of the shipped networks lie compiled, for stacks whose sandbox keeps nothing.

A stack's home folder is empty at every start, and Warp's cache with it: on an H200 the first case
waited 3.5 s for the same kernels each time. A process of ours compiles them once per user and kind
of device, outside every sandbox; stacks read them there and cannot write.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from schemas.kinds.installed import version_of
from twin.base.cache import cache_folder, is_trusted
from twin.base.errors import UsageError
from twin.base.software import hardware_class, package_folder

VARIABLE = "TWIN_COMPILED_KERNELS"
"""Environment variable of a stack's process: the folder, in which Warp made one per version."""

SOURCES = (
    *("detector/resize.py", "detector/stem.py", "detector/thin.py"),
    *("detector/integer/convolution.py", "detector/integer/map_kernels.py"),
)
"""Files of ``devkit`` that define the kernels."""


def compiled_folder(device: str) -> Path | None:
    """The folder for a kind of device, which is there once all is compiled.

    None: no such device here, or others may write to the cache of this user.
    """
    cache = cache_folder()
    try:
        parts = [hardware_class(device), version_of("warp-lang")]
    except UsageError:
        return None
    if not is_trusted(cache):
        return None
    root = package_folder("devkit")
    content = [part.encode() for part in parts] + [(root / name).read_bytes() for name in SOURCES]
    key = hashlib.sha256(b"\0".join(content)).hexdigest()[:16]
    return cache / "kernels" / key


def link_compiled(cache: Path) -> None:
    """Have the modules that :data:`VARIABLE` names in a kernel cache of one's own.

    Files are linked one by one: what is missing for another device is compiled beside them.
    """
    source = os.environ.get(VARIABLE, "")
    for file in sorted(Path(source).glob("*/*/*")) if source else ():
        place = cache / file.parent.name
        place.mkdir(exist_ok=True)
        if not (place / file.name).exists():
            (place / file.name).symlink_to(file)
