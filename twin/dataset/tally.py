"""What a dataset holds: labels and ignored boxes by class, split, size, distance, hour, weather."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.messages import OBJECT_CLASSES
from schemas.names import WEATHERS

HEIGHTS_PX = (8, 16, 32, 64)
"""Limits between groups of box heights [px]."""
DISTANCES_M = (15, 30, 60, 120)
"""[m]"""

_HOURS = 3
_Row = dict[str, Any]
_AXES: dict[str, Callable[[_Row, _Row], str]] = {
    "split": lambda image, _: image["split"],
    "height_px": lambda _, row: _group(row["bbox"][3], HEIGHTS_PX),
    "distance_m": lambda _, row: _group(row["distance_m"], DISTANCES_M),
    "hour": lambda image, _: (
        f"{int(image['hour'] // _HOURS) * _HOURS:02d}-"
        f"{int(image['hour'] // _HOURS) * _HOURS + _HOURS:02d}"
    ),
    "weather": lambda image, _: image["weather"],
}
_ORDER = {
    "height_px": [*(f"< {n}" for n in HEIGHTS_PX), f">= {HEIGHTS_PX[-1]}"],
    "distance_m": [*(f"< {n}" for n in DISTANCES_M), f">= {DISTANCES_M[-1]}"],
    "weather": [*WEATHERS, "custom"],
}


def _group(value: float, limits: tuple[int, ...]) -> str:
    """The group as in ``< 16``: from the limit before on."""
    at = bisect_right(limits, value)
    return f"< {limits[at]}" if at < len(limits) else f">= {limits[-1]}"


def tally(dataset: Path) -> dict[str, Any]:
    """Count a complete dataset.

    Returns:
        ``images``: by split. ``labels`` and ``ignored``: per axis (split, height_px, distance_m,
        hour, weather) and group, boxes by class. ``ignored_for``: by class, boxes by reason; a box
        may have several.
    """
    images: Counter[str] = Counter()
    counted: dict[bool, dict[str, dict[str, Counter[str]]]] = {
        ignored: {axis: {} for axis in _AXES} for ignored in (False, True)
    }
    reasons: dict[str, Counter[str]] = {name: Counter() for name in OBJECT_CLASSES}
    for path in sorted(dataset.glob("annotations/*.json")):
        document = json.loads(read_regular(path, RUN_FILE_BYTES_MAX))
        by_id = {image["id"]: image for image in document["images"]}
        images[document["info"]["split"]] += len(by_id)
        for row in document["annotations"]:
            name = OBJECT_CLASSES[row["category_id"] - 1]
            for axis, group_of in _AXES.items():
                groups = counted[bool(row["ignore"])][axis]
                group = group_of(by_id[row["image_id"]], row)
                groups.setdefault(group, Counter())[name] += 1
            reasons[name].update(row["ignored_for"])
    return {
        "images": dict(images),
        "labels": _plain(counted[False]),
        "ignored": _plain(counted[True]),
        "ignored_for": {name: dict(sorted(found.items())) for name, found in reasons.items()},
    }


def _plain(axes: dict[str, dict[str, Counter[str]]]) -> dict[str, Any]:
    found = {}
    for axis, groups in axes.items():
        order = _ORDER.get(axis)
        names = [name for name in order if name in groups] if order else list(groups)
        names = names if order or axis == "split" else sorted(names)
        found[axis] = {group: {n: groups[group][n] for n in OBJECT_CLASSES} for group in names}
    return found


def print_tally(found: dict[str, Any]) -> None:
    """Print the counts as a table: labels, and how many boxes of the group are ignored."""
    images = found["images"]
    total = ", ".join(f"{split} {count}" for split, count in images.items())
    table = Table(title=f"{sum(images.values())} images: {total}", title_justify="left")
    table.add_column("labels (ignored)")
    for name in OBJECT_CLASSES:
        table.add_column(name, justify="right")
    for axis in _AXES:
        labels, ignored = found["labels"][axis], found["ignored"][axis]
        order = _ORDER.get(axis) or sorted({*labels, *ignored})
        order = list(images) if axis == "split" else order
        for group in (one for one in order if one in labels or one in ignored):
            good, bad = labels.get(group, {}), ignored.get(group, {})
            cells = (f"{good.get(name, 0)} ({bad.get(name, 0)})" for name in OBJECT_CLASSES)
            table.add_row(f"{axis} {group}", *cells)
        table.add_section()
    for reason in sorted({r for reasons in found["ignored_for"].values() for r in reasons}):
        counts = [found["ignored_for"][name].get(reason, 0) for name in OBJECT_CLASSES]
        table.add_row(f"ignored for {reason}", *(f"({count})" for count in counts))
    Console(width=120).print(table)
