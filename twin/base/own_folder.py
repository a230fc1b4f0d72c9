"""The folder of this user alone: keys, defaults of a site, whom the user trusts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from twin.base.errors import UsageError

VARIABLE = "DRIVETWIN_HOME"
"""Names another folder than ``~/.config/drivetwin``."""


def own_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """``DRIVETWIN_HOME``, else ``drivetwin`` where this user's programs keep what is theirs.

    Raises:
        UsageError: there is no home folder.
    """
    if folder := environment.get(VARIABLE, ""):
        return Path(folder).absolute()
    if config := environment.get("XDG_CONFIG_HOME", ""):
        return Path(config).absolute() / "drivetwin"
    try:
        return Path.home() / ".config" / "drivetwin"
    except RuntimeError:
        raise UsageError(
            f"there is no home folder to keep keys in; set {VARIABLE} to a folder of your own"
        ) from None
