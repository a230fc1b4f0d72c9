"""Scenery of scene files beside OpenDRIVE roads: rows of houses, trees and street lamps."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from twin.world.spec import Length, Range, Share, Spec

ROWS_MAX = 64
"""Most rows of houses, of trees and of street lamps."""

Side = Literal["left", "right", "both"]
Station = Annotated[float, Meta(ge=0, le=1e6)]


class HouseRow(Spec, kw_only=True):
    """Houses along roads, their fronts towards the road."""

    road: str = ""
    """Id of its road; empty: all roads that do not lead through a junction."""
    side: Side = "both"
    """As seen along the road's reference line."""
    from_m: Station = 0.0
    """Station of its beginning [m]."""
    to_m: Station | None = None
    """Station of its end; left out: the end of the road [m]."""
    offset_m: Annotated[float, Meta(ge=0, le=500)] = 3.0
    """From the outermost lane to the fronts [m]."""
    width_m: Range = field(default_factory=lambda: [9.0, 18.0])
    """Smallest and largest width along the road [m]."""
    height_m: Range = field(default_factory=lambda: [7.0, 14.0])
    depth_m: Length = 11.0
    gap_m: Annotated[list[float], Meta(min_length=2, max_length=2)] = field(
        default_factory=lambda: [0.0, 6.0]
    )
    """Smallest and largest gap between two houses [m]."""
    share: Share = 1.0
    """Share of the places that are built on [-]."""

    def __post_init__(self) -> None:
        for name in ("width_m", "height_m", "gap_m"):
            low, high = getattr(self, name)
            if not 0.0 <= low <= high <= 2000.0:
                raise ValueError(f"{name}: {low:g} to {high:g}; smallest first, from 0 to 2000")
        if self.width_m[0] < 4.0 or self.height_m[0] < 6.0:
            raise ValueError("width_m and height_m: a house is at least 4 m wide and 6 m high")
        _check_order(self.from_m, self.to_m)


class TreeRow(Spec, kw_only=True):
    """Trees along roads."""

    road: str = ""
    """Id of its road; empty: all roads that do not lead through a junction."""
    side: Side = "both"
    from_m: Station = 0.0
    to_m: Station | None = None
    offset_m: Annotated[float, Meta(ge=0, le=500)] = 2.0
    """From the outermost lane to the trunks [m]."""
    spacing_m: Annotated[float, Meta(ge=2, le=2000)] = 12.0
    jitter_m: Annotated[float, Meta(ge=0, le=20)] = 0.0
    """How far a trunk may stand from its place, along and away from the road [m]."""
    height_m: Range = field(default_factory=lambda: [5.0, 9.0])

    def __post_init__(self) -> None:
        low, high = self.height_m
        if low > high or high > 60.0:
            raise ValueError(f"height_m: {low:g} to {high:g}; smallest first, up to 60")
        _check_order(self.from_m, self.to_m)


class LampRow(Spec, kw_only=True):
    """Street lamps along a road; their arms reach towards its reference line."""

    road: str = ""
    """Id of its road; empty: all roads that do not lead through a junction."""
    from_m: Station = 0.0
    """Station of the first lamp [m]."""
    to_m: Station | None = None
    """Last station at which one may stand; left out: the end of the road [m]."""
    spacing_m: Annotated[float, Meta(ge=2, le=2000)] = 25.0
    lateral_m: Annotated[float, Meta(ge=-500, le=500)]
    """From the reference line to the posts, to the left positive [m]."""

    def __post_init__(self) -> None:
        _check_order(self.from_m, self.to_m)


def _check_order(from_m: float, to_m: float | None) -> None:
    if to_m is not None and to_m <= from_m:
        raise ValueError(f"to_m {to_m:g} must lie behind from_m {from_m:g}")


class RoadScenery(Spec, kw_only=True):
    """What is generated beside the roads of a file."""

    houses: Annotated[list[HouseRow], Meta(max_length=ROWS_MAX)] = field(default_factory=list)
    trees: Annotated[list[TreeRow], Meta(max_length=ROWS_MAX)] = field(default_factory=list)
    lamps: Annotated[list[LampRow], Meta(max_length=ROWS_MAX)] = field(default_factory=list)
    """Street lamps as high and as bright as ``furniture`` says."""
