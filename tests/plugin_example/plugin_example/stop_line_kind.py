from typing import Annotated

from msgspec import Meta, Struct

from schemas.kinds.kpi import CurveLook, KpiKind
from schemas.kinds.scenario import ExtremeTable, LeadMeasure, ScenarioKind, ScenarioReport
from schemas.kinds.verdict import VerdictKind


class StopLineConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of ``stop_line``."""

    line_m: Annotated[float, Meta(gt=0, le=200)] = 30.0
    """From the place where the ego's nose starts to the line [m]."""
    short_max_m: Annotated[float, Meta(gt=0, le=50)] = 3.0
    """Farthest before the line that a stop passes [m]."""
    air_c: Annotated[float, Meta(ge=-60, le=60)] = 20.0
    """Temperature of the air [deg C]."""


KPIS = (
    KpiKind(
        name="to_line_m",
        place="column",
        type="float64",
        unit="m",
        doc="From the ego's nose to the line, negative behind it",
        nullable=True,
        curve=CurveLook(place=0, title="To the line", axis="line [m]", scale="signed"),
    ),
    KpiKind(
        name="stopped_before_m",
        place="scalar",
        type="float64",
        unit="m",
        nullable=True,
        label="Before the line [m]",
        compared="Distance to the line at the end [m]",
    ),
)
KIND = ScenarioKind(
    name="stop_line",
    doc="the ego is to stop at a line",
    config=StopLineConfig,
    implementation="plugin_example.stop_line:StopLine",
    target="parked car 13",
    stops_for_target=False,
    verdicts=(
        VerdictKind(name="over_the_line", tone="bad", rank=2, color="#882255", symbol="⤒"),
        VerdictKind(name="too_short", tone="doubtful", rank=6, color="#999933", symbol="⤓"),
    ),
    kpis=("to_line_m", "stopped_before_m", "jerk_mps3", "jerk_peak_mps3"),
    report=ScenarioReport(
        rule="Passed means: the ego stopped at most {short_max_m:g} m before the line.",
        rule_in_results="*Pass*: the ego stopped at most {short_max_m:g} m before the line.",
        curves=("to_line_m", "jerk_mps3", "brake", "speed_mps"),
        overview=("to_line_m", "jerk_mps3", "brake"),
        table=("stopped_before_m", "jerk_peak_mps3", "speed_max_mps", "sim_time_s"),
        lead=LeadMeasure(
            scalar="stopped_before_m",
            of="decided",
            head="Before the line",
            title="Distance from the ego's nose to the line at the end",
            text="the distance to the line",
            hover="{:.2f} m before the line",
        ),
        extreme=ExtremeTable(
            scalar="stopped_before_m",
            largest=False,
            of="decided",
            title="Nearest to the line",
            head="Before the line [m]",
            said="Nearest to the line",
            said_head="before the line [m]",
        ),
    ),
)
