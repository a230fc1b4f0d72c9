"""Declaration of ``between``: the ego is to stop between two things that stand at its lane."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.kinds.scenario import ExtremeTable, LeadMeasure, ScenarioKind, ScenarioReport
from schemas.kinds.verdict import VerdictKind


class BetweenConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of ``between``."""

    approach_m: Annotated[float, Meta(ge=1, le=100)] = 20.0
    """From the ego's start to the first of the two; between only [m]."""


_REPORT = ScenarioReport(
    rule="Passed means: the ego came to rest between the two things.",
    rule_in_results="*Pass*: the ego came to rest between the two things.",
    curves=("dtc_m", "throttle", "brake", "speed_mps"),
    overview=("dtc_m", "brake"),
    table=("dtc_min_m", "decel_peak_mps2", "speed_max_mps", "sim_time_s"),
    lead=LeadMeasure(
        scalar="dtc_end_m",
        of="decided",
        head="Distance to the first at the end",
        title="Distance to the first thing at the end",
        text="the distance to the first thing at the end",
        hover="{:.2f} m from the first thing",
    ),
    extreme=ExtremeTable(
        scalar="dtc_end_m",
        largest=True,
        of="decided",
        title="Farthest from the first",
        head="Distance [m]",
        said="Farthest from the first",
        said_head="distance [m]",
    ),
)

KIND = ScenarioKind(
    name="between",
    doc="the ego is to stop between two things that stand at its lane",
    config=BetweenConfig,
    implementation="twin.scenario.between.family:Between",
    report=_REPORT,
    target="parked car 13",
    further_targets=("obstacle",),
    stops_for_target=False,
    verdicts=(
        VerdictKind(name="too_near", tone="doubtful", rank=6, color="#999933", symbol="⤓"),
        VerdictKind(name="too_far", tone="bad", rank=2, color="#882255", symbol="⤒"),
    ),
)
