"""The campaign section ``scenario``: what the ego is asked to do, and when that counts as done."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.words import agree


class Scenario(Struct, frozen=True, forbid_unknown_fields=True):
    """What the ego is asked to do, where, and when that counts as done."""

    type: Literal["jump_scare", "lane_keeping"] = "jump_scare"
    """``jump_scare``: a broken-down car stands in the ego's lane. ``lane_keeping``: the ego follows
    its lane from its beginning on."""
    scene: str = "downtown"
    """Name of a shipped scene, or the path of a scene file."""
    vehicle: str = "opencav"
    """Name of a shipped vehicle, or the path of a vehicle file."""
    ego_start_m: Annotated[float, Meta(ge=5, le=180)] = 148.0
    """Hull-to-hull distance from the ego to the broken-down car; jump_scare only [m]."""
    ego_speed_mps: Annotated[float, Meta(ge=0, le=30)] = 0.0
    """Speed of the ego at the start [m/s]."""
    duration_s: Annotated[float, Meta(ge=0.1, le=3600)] = 60.0
    """Longest sim time of a case [s]."""
    standstill_s: Annotated[float, Meta(ge=0, le=60)] = 2.0
    """The case ends this long after the ego has come to rest [s]."""
    false_braking_m: Annotated[float, Meta(gt=0, le=1000)] = 30.0
    """Coming to rest further than this from the obstacle is false braking; jump_scare only [m]."""
    distance_m: Annotated[float, Meta(ge=1, le=100_000)] = 1000.0
    """Way along the lane after which the case ends; lane_keeping only [m]."""
    lateral_limit_m: Annotated[float, Meta(gt=0, le=10)] = 0.75
    """Largest distance of the rear axle's middle from the lane's centre; beyond it the ego leaves
    its lane and the case ends; lane_keeping only [m]."""
    lateral_rms_limit_m: Annotated[float, Meta(gt=0, le=10)] = 0.25
    """Largest root mean square of that distance over the case; lane_keeping only [m]."""

    def __post_init__(self) -> None:
        """Refuse limits that the type would not look at."""
        defaults = dict(zip(Scenario.__struct_fields__, Scenario.__struct_defaults__, strict=True))
        for type_, names in _OF_TYPE.items():
            foreign = [name for name in names if getattr(self, name) != defaults[name]]
            if self.type != type_ and foreign:
                raise ValueError(
                    f"{' and '.join(foreign)} {agree(len(foreign), 'is', 'are')} set, but "
                    f"{agree(len(foreign), 'it belongs', 'they belong')} to type {type_} and this "
                    f"is {self.type}"
                )


_OF_TYPE = {
    "jump_scare": ("ego_start_m", "false_braking_m"),
    "lane_keeping": ("distance_m", "lateral_limit_m", "lateral_rms_limit_m"),
}
"""Keys of the scenario that only one type looks at."""
