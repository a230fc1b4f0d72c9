from typing import Annotated

from msgspec import Meta, Struct

from schemas.kinds.perception import PerceptionKind


class TunnelVision(Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="tunnel"):
    """The simulator's boxes in the middle of the picture."""

    share: Annotated[float, Meta(gt=0, le=1)] = 0.5
    """Of the picture's width [-]."""


KIND = PerceptionKind(
    name="tunnel",
    config=TunnelVision,
    implementation="plugin_example.tunnel:Tunnel",
    told_truth=True,
    text="the simulator's boxes in the middle of the picture",
)
