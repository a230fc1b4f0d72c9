"""Whether pictures can be rendered without a window."""

from __future__ import annotations

import os
from pathlib import Path


def has_vulkan() -> bool:
    """A Vulkan driver is installed; rendering without a window needs one."""
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if named:
        return any(Path(path).is_file() for path in named.split(":"))
    roots = ("/usr/share", "/usr/local/share", "/etc")
    return any(any(Path(root, "vulkan", "icd.d").glob("*.json")) for root in roots)
