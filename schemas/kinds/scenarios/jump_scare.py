"""Declaration of ``jump_scare``: a broken-down car stands in the ego's lane."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.kinds.scenario import (
    ExtremeTable,
    LeadMeasure,
    ScenarioKind,
    ScenarioReport,
    VerdictTable,
)


class JumpScareConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of ``jump_scare``."""

    ego_start_m: Annotated[float, Meta(ge=5, le=180)] = 148.0
    """Hull-to-hull distance from the ego to the broken-down car; jump_scare only [m]."""
    false_braking_m: Annotated[float, Meta(gt=0, le=1000)] = 30.0
    """Coming to rest further than this from the obstacle is false braking; jump_scare only [m]."""


_REPORT = ScenarioReport(
    rule="Passed means the verdict pass: the ego came to rest within {false_braking_m:g} m of the "
    "obstacle, or went round it, without a collision. Stopping further away (false braking), "
    "running out of time before it and a case without a verdict are no pass.",
    rule_in_results="*Pass*: the ego came to rest within {false_braking_m:g} m of the obstacle, or "
    "went round it, without a collision.",
    curves=("aeb", "dtc_m", "collisions", "throttle", "brake", "speed_mps"),
    overview=("aeb", "dtc_m", "collisions", "throttle", "brake"),
    table=(
        *("dtc_min_m", "impact_speed_mps", "aeb_time_s", "aeb_dtc_m", "aeb_ttc_s"),
        *("decel_peak_mps2", "speed_max_mps", "sim_time_s"),
    ),
    beside=(("AEB at [s]", "aeb_time_s"), ("distance then [m]", "aeb_dtc_m")),
    lead=LeadMeasure(
        scalar="dtc_min_m",
        of="unhurt",
        head="Closest approach without a collision",
        title="Smallest distance to collision of the cases without a collision",
        text="the smallest distance to the obstacle",
        hover="smallest distance {:.3f} m",
    ),
    extreme=ExtremeTable(
        scalar="dtc_min_m",
        largest=False,
        of="unhurt",
        title="Closest passes",
        head="Min DTC [m]",
        said="Closest approach without a collision",
        said_head="smallest distance [m]",
    ),
    extremes_title="Closest and slowest",
    counted_title="False braking",
    counted=(
        VerdictTable(
            verdict="false_braking",
            some="Cases that came to rest further than {false_braking_m:g} m from the obstacle",
            none="No case braked falsely.",
        ),
    ),
)

KIND = ScenarioKind(
    name="jump_scare",
    doc="a broken-down car stands in the ego's lane",
    config=JumpScareConfig,
    implementation="twin.scenario.jump_scare.family:JumpScare",
    report=_REPORT,
    stops_for_target=True,
    as_autodrive=True,
)
