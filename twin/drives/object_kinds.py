"""Kinds of recorded objects, by the words or labels of their messages."""

from __future__ import annotations

from twin.ros2.motion import LABELS

_WORDS = (
    ("motorcycle", ("motorcycle", "motorbike", "motor_bike", "scooter")),
    ("bicycle", ("bicycle", "cyclist", "bike", "rider")),
    ("child", ("child",)),
    ("pedestrian", ("pedestrian", "person", "human", "walker")),
    ("animal", ("animal", "deer", "dog")),
    ("trailer", ("trailer",)),
    ("truck", ("truck", "lorry")),
    ("bus", ("bus", "coach")),
    ("van", ("van",)),
    ("car", ("car", "vehicle", "taxi")),
)
"""Words by kind; a text is of the first kind of which it holds a word."""

_KINDS = {label: kind for kind, label in reversed(LABELS.items())}
"""Kinds by label; of those of equal label the first."""


def kind_of_words(words: str) -> str:
    """Kind of an object by a text, as ``vehicle.car``; empty: the text says nothing."""
    text = words.lower()
    return next((kind for kind, names in _WORDS if any(name in text for name in names)), "")


def kind_of_label(label: int) -> str:
    """Kind of an object by Autoware's label; empty: unknown."""
    return _KINDS.get(label, "")
