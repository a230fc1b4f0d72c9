"""The surface of a road network as triangles."""

from __future__ import annotations

import numpy as np

from twin.road.opendrive.road_map import RoadMap
from twin.road.surface.ground import ground_around
from twin.road.surface.lane_strips import lane_strips, side_slopes
from twin.road.surface.mark_strips import mark_strips
from twin.road.surface.patch import SurfacePatch, merged
from twin.road.surface.stations import section_stations

FACES_MAX = 5_000_000
"""Most triangles of a network."""


def road_surface(roads: RoadMap) -> tuple[SurfacePatch, ...]:
    """Lanes, kerbs and marks of all roads, and the ground around; one patch for each look.

    Lanes are within 1 cm of the exact surface, marks 6 mm above them.

    Raises:
        ValueError: there are too many triangles, or no lane has an area; one line.
    """
    patches: list[SurfacePatch] = []
    faces = 0
    for frame in roads.frames.values():
        for number in range(len(frame.sections)):
            try:
                s = section_stations(frame, number)
            except ValueError as error:
                name = frame.road.id[:40]
                raise ValueError(f"{roads.network.file}: road {name}: {error}") from None
            for maker in (lane_strips, mark_strips, side_slopes):
                for patch in maker(frame, number, s):
                    if patch is None:
                        continue
                    patches.append(patch)
                    faces += len(patch.faces)
                    if faces > FACES_MAX:
                        raise ValueError(
                            f"{roads.network.file}: its surface has more than {FACES_MAX} "
                            f"triangles, at road {frame.road.id[:40]}"
                        )
    whole = merged(patches)
    lanes = [patch.points_m for patch in whole if patch.kind == "lane"]
    if not lanes:
        raise ValueError(f"{roads.network.file}: no lane has an area")
    return merged([*whole, ground_around(np.concatenate(lanes))])
