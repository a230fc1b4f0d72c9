"""The folder for what is fetched once and never changes."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """``TWIN_CACHE``, on a cluster a folder that all nodes share; else one in the home folder."""
    given = os.environ.get("TWIN_CACHE", "")
    return Path(given).absolute() if given else Path.home() / ".cache/drivetwin"
