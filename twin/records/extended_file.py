"""Campaign files that say only what differs from another one: ``extends``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from schemas.files.proposals import with_proposals
from schemas.files.yaml_file import YamlError, load_yaml
from schemas.validation import Mistake
from twin.base.errors import UsageError

KEY = "extends"
"""Key of the campaign that a file builds on: a shipped name, or a path from the file's folder."""
DEPTH_MAX = 4
"""Most files that build on each other."""


def read_extended(path: Path, shown: str, find: Callable[[str], Path]) -> Any:
    """The content of a campaign file, with that of the files it builds on.

    Keys at the top of a file replace those of the file that it extends, whole: its ``autonomy`` is
    not mixed with the other's. The name is never inherited, since a run's folder is named by it.

    Args:
        path: of the file.
        shown: its name in messages.
        find: the file of a shipped name or of a path.

    Raises:
        UsageError: a file cannot be read, ``extends`` names none, or too many build on each other.
    """
    data = _read(path)
    layers = []
    while isinstance(data, dict) and KEY in data:
        layers.append(data)
        if len(layers) >= DEPTH_MAX:
            raise UsageError(
                Mistake(KEY, f"at most {DEPTH_MAX} files may build on each other").line(shown)
            )
        name = data[KEY]
        if not isinstance(name, str) or not name:
            message = "give the name of a shipped campaign, or the path of a campaign file"
            raise UsageError(Mistake(KEY, message).line(shown))
        if "campaign" not in data:
            message = f"a file that extends '{name}' needs a name of its own"
            raise UsageError(Mistake("campaign", message).line(shown))
        path = _base(name, path.parent, shown, find)
        data = _read(path)
    for layer in reversed(layers):
        if not isinstance(data, dict):
            raise UsageError(Mistake(KEY, f"{path}: no campaign, but a list or text").line(shown))
        data = {**data, **{key: value for key, value in layer.items() if key != KEY}}
    return data


def _base(name: str, folder: Path, shown: str, find: Callable[[str], Path]) -> Path:
    beside = folder / name
    if beside.is_file():
        return beside
    try:
        return find(name)
    except UsageError as error:
        raise UsageError(Mistake(KEY, str(error)).line(shown)) from None


def _read(path: Path) -> Any:
    try:
        return with_proposals(load_yaml(path), path.parent, str(path))
    except YamlError as error:
        raise UsageError(str(error)) from None
