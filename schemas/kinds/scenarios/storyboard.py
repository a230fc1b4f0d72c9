"""Declaration of ``storyboard``: other road users do what a scenario file says."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.scenario import ExtremeTable, LeadMeasure, ScenarioKind, ScenarioReport
from schemas.kinds.verdict import TRIAL_VERDICTS
from schemas.sections.free_driving import FreeDriving
from schemas.sections.trial import Trial


class StoryboardConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of ``storyboard``."""

    storyboard: Annotated[str, Meta(min_length=1, max_length=4096)]
    """Name of a shipped scenario, or the path of a scenario file, YAML or OpenSCENARIO XML;
    storyboard only."""
    driver: Literal["stack", "robot"] = "stack"
    """Who drives the ego: ``stack``, from the start on; ``robot``: as on a proving ground, a robot
    holds the scenario's path and speed until the stack brakes or steers away; storyboard only."""
    robot_brake: Annotated[float, Meta(gt=0, le=1)] = 0.05
    """Brake or handbrake of the stack from which on the robot lets go, share of full braking; so
    much slows a car down by about 0.5 m/s^2, between the 0.3 and 1 m/s^2 by which Euro NCAP tells
    when an emergency brake acts; storyboard only."""
    robot_steering_deg: Annotated[float, Meta(gt=0, le=90)] = 3.0
    """Steering of the stack from which on the robot lets go: angle of the road wheels outside of
    what lies between straight ahead and the robot's path. A stack that keeps the lane in which the
    robot drives stays below it, and so does one that never steers [deg]; storyboard only."""
    environment: Literal["file", "campaign"] = "file"
    """Weather, light and friction where the scenario file has environment actions: ``file``, as
    they say, with the campaign's for what they leave open; ``campaign``: they count for nothing but
    the file's own conditions; storyboard only."""
    numbers: dict[str, float] = {}
    """Numbers of the scenario file that are others than it says, by their names there:
    ``actors.van.ahead_m``, or a parameter of OpenSCENARIO; storyboard only."""
    trial: Trial | None = None
    """What a run must fulfil; not given: reach the storyboard's end without a collision. Rows of a
    rulebook give their own; storyboard only."""
    free_driving: FreeDriving | None = None
    """The stack is watched for full brakings without a cause while a robot drives; a full braking
    is one of at least `robot_brake`; storyboard only."""

    def __post_init__(self) -> None:
        if self.free_driving is None:
            return
        if self.driver != "robot":
            raise ValueError("free_driving needs driver: robot, which keeps to the road's speeds")
        if self.trial is not None:
            raise ValueError("trial and free_driving judge a case each; give one of them")


_CURVES = ("events_started", "dtc_m", "aeb", "collisions", "throttle", "brake", "speed_mps")

_REPORT = ScenarioReport(
    rule="Passed means: the storyboard came to its end, and the ego collided with nothing until "
    "then. A collision, running out of time before the storyboard's end and a case without a "
    "verdict are no pass. Distances are those to the nearest road user.",
    rule_in_results="*Pass*: the storyboard came to its end without a collision of the ego.",
    curves=_CURVES,
    overview=_CURVES,
    table=(
        *("dtc_min_m", "impact_speed_mps", "aeb_time_s", "aeb_ttc_s", "events_started"),
        *("intervention_time_s", "intervention_kind", "intervention_speed_mps"),
        *("intervention_dtc_m", "intervention_ttc_s", "warning_time_s", "warning_ttc_s"),
        *("trial_speed_mps", "impact_relative_mps", "speed_reduction_mps"),
        *("driven_m", "partial_brakings", "full_braking_s", "full_braking_ttc_s"),
        *("event_last_s", "decel_peak_mps2", "speed_max_mps", "sim_time_s"),
    ),
    beside=(("AEB at [s]", "aeb_time_s"), ("last event [s]", "event_last_s")),
    lead=LeadMeasure(
        scalar="dtc_min_m",
        of="unhurt",
        head="Closest approach without a collision",
        title="Smallest distance to another road user of the cases without a collision",
        text="the smallest distance to another road user",
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
)

KIND = ScenarioKind(
    name="storyboard",
    doc="other road users do what a scenario file says",
    config=StoryboardConfig,
    implementation="twin.scenario.storyboard.case.family:StoryboardFamily",
    report=_REPORT,
    stops_for_target=False,
    verdicts=TRIAL_VERDICTS,
    kpis=(
        *("storyboard_running", "events_started", "event_last", "event_last_s"),
        *("storyboard_end_s", "robot_drives", "intervention_kind", "intervention_time_s"),
        *("intervention_speed_mps", "intervention_dtc_m", "intervention_ttc_s"),
        *("warning", "warning_time_s", "warning_ttc_s", "warning_before_braking_s"),
        *("light_lx", "road_friction", "target_x_m", "target_y_m", "target_yaw_rad"),
        *("target_vx_mps", "target_vy_mps", "trial_begin_s", "trial_speed_mps"),
        *("trial_closing_mps", "trial_lateral_m", "trial_acted_s", "impact_relative_mps"),
        *("speed_reduction_mps", "way_ttc_s", "driven_m", "driven_fast_m", "partial_brakings"),
        *("full_braking_s", "full_braking_ttc_s", "false_brakings"),
    ),
    files=("storyboard",),
    brings_scene="storyboard",
    scene_name="twin.scenario.storyboard.case.files:scene_name",
    numbers="numbers",
    trial="trial",
    motion="twin.scenario.storyboard.case.motion:StoryboardMotion",
    bodies=32,
    ends_at_rest=False,
    nearest=True,
    checks="twin.scenario.storyboard.case.checks:case_mistakes",
)
