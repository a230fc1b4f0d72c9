"""Rows of street lamps beside the roads of a file, as a scene file places them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.road.opendrive.road_map import RoadMap
from twin.world.meshes.mesh import MeshBuilder
from twin.world.roadside.objects import LUMINAIRE_M, RoadsideHulls, check_points
from twin.world.roadside.scenery import frames_of
from twin.world.scenery import LampRow
from twin.world.street.furniture import add_lamp

LAMPS_MAX = 2_000
"""Most lamps of the rows of a scene."""
_HALF_POST_M = 0.05
_END_M = 1e-6


def add_lamp_rows(
    mesh: MeshBuilder, roads: RoadMap, rows: Sequence[LampRow], height_m: float
) -> RoadsideHulls:
    """Add the street lamps of a scene file; their posts are solid.

    Args:
        mesh: receives them.
        roads: the roads.
        rows: where they stand.
        height_m: of their luminaires above their feet.

    Raises:
        ValueError: a row names a road that does not exist, or there are too many; one line.
    """
    standing = RoadsideHulls()
    for number, row in enumerate(rows):
        for frame in frames_of(roads, row, f"lamps[{number}]"):
            end_m = frame.road.length_m if row.to_m is None else min(row.to_m, frame.road.length_m)
            stations_m = np.arange(row.from_m, end_m + _END_M, row.spacing_m)
            if len(standing.hulls) + len(stations_m) > LAMPS_MAX:
                raise ValueError(f"scenery.lamps: more than {LAMPS_MAX} lamps; use fewer")
            inward = -1.0 if row.lateral_m > 0.0 else 1.0
            posts = frame.pose(np.minimum(stations_m, frame.road.length_m), row.lateral_m)
            heads = frame.pose(
                np.minimum(stations_m, frame.road.length_m), row.lateral_m + inward * LUMINAIRE_M
            )
            for k in range(len(stations_m)):
                x, y, heading = (float(v[k]) for v in (posts.x_m, posts.y_m, posts.heading_rad))
                # The arm of the lamp reaches along its -y axis.
                turn = 0.0 if row.lateral_m > 0.0 else np.pi
                with mesh.place(x, y, heading + turn, z_m=float(posts.z_m[k])):
                    add_lamp(mesh, height_m)
                standing.lamps_m.append((float(heads.x_m[k]), float(heads.y_m[k])))
                standing.add("street lamp", "pole", [(x, y, heading, _HALF_POST_M, _HALF_POST_M)])
            check_points(mesh, roads.network.file)
    return standing
