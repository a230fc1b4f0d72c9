"""The tables of a network on a device, as a struct that kernels take."""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.road.tables.road_tables import RoadTables, driven_codes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class RoadArrays:
    """The arrays of ``RoadTables``, see there; make it with :func:`road_arrays`."""

    count: wp.int32
    """Of roads; 0: flat ground."""
    measured: wp.int32
    """1: there is a table of way lengths."""
    roads: wp.array2d(dtype=wp.int32)
    extents: wp.array2d(dtype=wp.float64)
    lines: wp.array2d(dtype=wp.float64)
    profiles: wp.array2d(dtype=wp.float64)
    widths: wp.array2d(dtype=wp.float64)
    section_starts: wp.array(dtype=wp.float64)
    sections: wp.array2d(dtype=wp.int32)
    lanes: wp.array2d(dtype=wp.int32)
    driven: wp.array(dtype=wp.int32)
    """By lane type code: 1 where cars drive."""
    way_first: wp.array(dtype=wp.int32)
    ways: wp.array2d(dtype=wp.int32)
    way_turns: wp.array(dtype=wp.float64)
    way_lanes: wp.array2d(dtype=wp.int32)
    lengths: wp.array2d(dtype=wp.float64)


def road_arrays(tables: RoadTables, device: wp.Device) -> RoadArrays:
    """The arrays of ``tables`` on a device."""

    def ints(rows: np.ndarray) -> wp.array:
        return _array(rows, wp.int32, device)

    def floats(rows: np.ndarray) -> wp.array:
        return _array(rows, wp.float64, device)

    roads = RoadArrays()
    roads.count = len(tables.road_ids)
    roads.measured = int(tables.lengths_m.size > 0)
    roads.roads = ints(tables.roads)
    roads.extents = floats(tables.extents)
    roads.lines = floats(tables.lines)
    roads.profiles = floats(tables.profiles)
    roads.widths = floats(tables.widths)
    roads.section_starts = floats(tables.section_starts_m)
    roads.sections = ints(tables.sections)
    roads.lanes = ints(tables.lanes)
    roads.driven = ints(driven_codes())
    roads.way_first = ints(tables.ways.first)
    roads.ways = ints(tables.ways.ways)
    roads.way_turns = floats(tables.ways.turns_rad)
    roads.way_lanes = ints(tables.ways.lanes)
    roads.lengths = floats(tables.lengths_m)
    return roads


def _array(rows: np.ndarray, kind: type, device: wp.Device) -> wp.array:
    """A device array; one without rows gets one, which nothing reads."""
    filled = rows if rows.size else np.zeros((1, *rows.shape[1:-1], max(rows.shape[-1], 1)))
    flat = filled.reshape(-1) if rows.ndim == 1 else filled
    return wp.array(np.ascontiguousarray(flat), dtype=kind, device=device)
