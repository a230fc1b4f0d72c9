"""Reads a recording with Rerun's own reader."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

_PROPERTIES = "/__properties/"


@dataclass(slots=True)
class ReadBack:
    """What a recording holds."""

    recording_id: str
    application_id: str
    blueprints: int
    """Embedded layouts."""
    rows: dict[str, int] = field(default_factory=dict)
    """Rows with a time, by entity path; static ones are not counted."""
    static: set[str] = field(default_factory=set)
    """Entity paths with static values."""
    properties: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By name: ``case``, ``verdict``."""


def begun(path: Path) -> bool:
    """Whether it can be read and says whose recording it is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)
        return bool(RrdReader(path).recordings())


def read_recording(path: Path) -> ReadBack:
    """Read all of ``path``; also works on the file of a recorder that was killed."""
    with warnings.catch_warnings():
        # The file of a killed recorder has no footer; that is what this reader says about it.
        warnings.simplefilter("ignore", RerunWarning)
        reader = RrdReader(path)
    store = reader.recordings()[0]
    found = ReadBack(store.recording_id, store.application_id, len(reader.blueprints()))
    for chunk in reader.stream(store=store):
        entity = str(chunk.entity_path)
        if entity.startswith(_PROPERTIES):
            values = chunk.to_record_batch().to_pydict()
            found.properties[entity.removeprefix(_PROPERTIES)] = {
                name: column[0][0]
                for name, column in values.items()
                if ":" not in name
                if not name.startswith("rerun.")
            }
        elif chunk.is_static:
            found.static.add(entity.strip("/"))
        else:
            name = entity.strip("/")
            found.rows[name] = found.rows.get(name, 0) + chunk.num_rows
    return found
