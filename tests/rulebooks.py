"""Campaigns with a rulebook, as plain data."""

from __future__ import annotations

from typing import Any

BRAKING: dict[str, Any] = {
    "row": "braking",
    "test": "Braking lead",
    "group": "cars",
    "values": {"ego.speed_kmh": [20, 40, 60], "actors.lead.ahead_m": 30},
    "repetitions": 3,
    "varied": {"ego.speed_kmh": [-1, 1]},
    "trial": {"rule": "avoid"},
}
CROSSING: dict[str, Any] = {
    "row": "crossing",
    "test": "Crossing cyclist",
    "group": "bicycles",
    "storyboard": "crossing-cyclist",
    "values": {"ego.speed_kmh": [30, 50], "actors.cyclist.speed_mps": [4.2, 5.6]},
    "conditions": {"weather": "heavy_rain", "scenario.load_kg": 100},
    "trial": {"rule": "limit", "impact_kmh": [[30, 0], [42, 10], [60, 35]]},
}


def rulebook_data(*rows: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A campaign of rows, :data:`BRAKING` and :data:`CROSSING` by default.

    Args:
        rows: as a file has them.
        changes: keys of the campaign that are others.
    """
    return {
        "campaign": "protocol",
        "seed": 7,
        "scenario": {"type": "storyboard", "storyboard": "braking-lead"},
        "autonomy": {
            "stack": "devkit.idle:IdleStack",
            "perception": {"truth": {"type": "ground_truth"}},
        },
        "rulebook": {
            "title": "A protocol",
            "source": "This test",
            "rank": "C",
            "groups": {"cars": {"title": "Cars"}, "bicycles": {"title": "Bicycles"}},
            "rows": list(rows or (BRAKING, CROSSING)),
        },
        **changes,
    }
