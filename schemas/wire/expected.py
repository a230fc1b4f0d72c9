"""What a stack may know about the cases of its rig before the first of them begins."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct, json

from schemas.case import Case
from schemas.sections.perception import Perception

EXPECTED_MAX = 16
"""Most different ones that a stack is told of: they travel on its command line."""


class Expected(Struct, frozen=True):
    """Perception with which some of the cases look at their pictures; fields as in an episode."""

    perception: Perception
    width: int
    height: int
    """Height of the main camera's pictures [px]."""
    device: str
    """Where the worker computes, ``cpu`` or ``cuda:N``."""
    files: dict[str, str] = {}
    """SHA-256 of the files that ``perception`` names."""


def expected_of(cases: Iterable[Case], device: str) -> list[Expected]:
    """Each different one of ``cases`` once, in their order, at most :data:`EXPECTED_MAX`."""
    expected: dict[bytes, Expected] = {}
    for case in cases:
        one = Expected(
            case.variation.perception,
            case.rig.camera.width,
            case.rig.camera.height,
            device,
            case.variation.files,
        )
        expected.setdefault(json.encode(one, order="deterministic"), one)
    return list(expected.values())[:EXPECTED_MAX]
