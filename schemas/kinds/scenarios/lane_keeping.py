"""Declaration of ``lane_keeping``: the ego follows its lane from its beginning on."""

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


class LaneKeepingConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of ``lane_keeping``."""

    distance_m: Annotated[float, Meta(ge=1, le=100_000)] = 1000.0
    """Way along the lane after which the case ends; lane_keeping only [m]."""
    lateral_limit_m: Annotated[float, Meta(gt=0, le=10)] = 0.75
    """Largest distance of the rear axle's middle from the lane's centre; beyond it the ego leaves
    its lane and the case ends; lane_keeping only [m]."""
    lateral_rms_limit_m: Annotated[float, Meta(gt=0, le=10)] = 0.25
    """Largest root mean square of that distance over the case; lane_keeping only [m]."""


_CURVES = ("lateral_error_m", "aeb", "dtc_m", "collisions", "throttle", "brake", "speed_mps")

_REPORT = ScenarioReport(
    rule="Passed means: the ego drove the whole distance along its lane, within the limits of the "
    "scenario. Leaving the lane, colliding, stopping on a free lane and running out of time are "
    "told apart; a case without a verdict has not passed.",
    rule_in_results="*Pass*: the ego drove the whole {distance_m:g} m along its lane, its rear "
    "axle at most {lateral_limit_m:g} m from the lane's centre and\n{lateral_rms_limit_m:g} m RMS. "
    "Leaving the lane, colliding, stopping on a free lane and running out of time are no pass.",
    curves=_CURVES,
    overview=_CURVES,
    table=(
        *("distance_m", "lateral_error_rms_m", "lateral_error_max_m", "impact_speed_mps"),
        *("aeb_time_s", "speed_max_mps", "sim_time_s"),
    ),
    beside=(
        ("lateral error RMS [m]", "lateral_error_rms_m"),
        ("distance driven [m]", "distance_m"),
    ),
    lead=LeadMeasure(
        scalar="lateral_error_rms_m",
        of="decided",
        head="Lateral error RMS",
        title="Root mean square of the rear axle's distance from the lane's centre",
        text="the lateral error RMS",
        hover="lateral error {:.3f} m RMS",
        digits=3,
    ),
    extreme=ExtremeTable(
        scalar="lateral_error_max_m",
        largest=True,
        of="decided",
        title="Furthest from the lane's centre",
        head="Largest error [m]",
        said="Farthest from the lane's centre",
        said_head="lateral error, largest [m]",
    ),
    extremes_title="Farthest and slowest",
    counted_title="Lane departures and stops",
    counted=(
        VerdictTable(
            verdict="lane_departure",
            some="Cases that left the lane",
            none="No case left the lane.",
        ),
        VerdictTable(
            verdict="false_braking",
            some="Cases that came to rest on the free lane",
            none="No case came to rest on the free lane.",
        ),
    ),
)

KIND = ScenarioKind(
    name="lane_keeping",
    doc="the ego follows its lane from its beginning on",
    config=LaneKeepingConfig,
    implementation="twin.scenario.lane_keeping.family:LaneKeeping",
    report=_REPORT,
    stops_for_target=False,
    checks="twin.scenario.lane_keeping.checks:case_mistakes",
)
