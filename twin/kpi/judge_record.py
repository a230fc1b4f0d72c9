"""``judge.json``: what a verdict is made of beside the KPI rows."""

from __future__ import annotations

import numpy as np
from msgspec import UNSET

from schemas import SCHEMA_VERSION
from schemas.case import Case
from schemas.files.judging import HitRecord, JudgeRecord, LaneRecord
from twin.road.lane import LanePath
from twin.scenario.surroundings import Surroundings
from twin.vehicle.columns import COLUMN, TELEMETRY
from twin.world.things import Thing


def judge_record(
    case: Case, state: np.ndarray, ground: Surroundings, hit: Thing | None
) -> JudgeRecord:
    """The record of a case that ends.

    Args:
        case: the case.
        state: its vehicle's state [T].
        ground: the lane and the target.
        hit: what the ego hit first.
    """
    lane, target = ground.lane, ground.target
    return JudgeRecord(
        v=SCHEMA_VERSION,
        case=case.id,
        scenario=case.variation.scenario,
        collisions=int(state[COLUMN["collisions"]]),
        impact_speed_mps=float(state[COLUMN["impact_speed_mps"]]),
        impact_step=int(state[COLUMN["impact_step"]]),
        moved=bool(state[COLUMN["moved"]]),
        target=None if target is None else tuple(target.tolist()),
        centre_offset_m=ground.centre_offset_m,
        half_length_m=ground.half_length_m,
        half_width_m=ground.half_width_m,
        lane=lane_record(lane),
        further=[None if hull is None else tuple(hull.tolist()) for hull in ground.further],
        hit=None if hit is None else HitRecord(hit.name, hit.kind, hit.hull, hit.hulls),
        target_name=ground.target_name,
        events=[*ground.events],
        formula=case.variation.formula or UNSET,
    )


def lane_record(lane: LanePath) -> LaneRecord:
    """The lane as a record has it."""
    return LaneRecord(
        lane.station_m.tolist(),
        [tuple(start) for start in lane.start.tolist()],
        lane.curvature.tolist(),
        lane.length_m,
        lane.closed,
    )


def state_of(record: JudgeRecord) -> np.ndarray:
    """The vehicle's state [T] as far as a verdict looks at it; zero elsewhere."""
    state = np.zeros(len(TELEMETRY))
    state[COLUMN["collisions"]] = record.collisions
    state[COLUMN["impact_speed_mps"]] = record.impact_speed_mps
    state[COLUMN["impact_step"]] = record.impact_step
    state[COLUMN["moved"]] = record.moved
    return state


def surroundings_of(record: JudgeRecord) -> Surroundings:
    """The lane and the target."""
    lane = LanePath(
        np.array(record.lane.station_m),
        np.array(record.lane.start),
        np.array(record.lane.curvature_per_m),
        record.lane.length_m,
        record.lane.closed,
    )
    target, *further = (
        None if hull is None else np.array(hull) for hull in (record.target, *record.further)
    )
    return Surroundings(
        lane,
        target,
        record.centre_offset_m,
        record.half_length_m,
        record.half_width_m,
        tuple(further),
        target_name=record.target_name,
        events=tuple(record.events),
    )


def hit_of(record: JudgeRecord) -> Thing | None:
    """The object that the ego hit first."""
    hit = record.hit
    return None if hit is None else Thing(hit.name, hit.kind, hit.hull, hit.hulls)
