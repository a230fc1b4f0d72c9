"""Traffic for free driving as scenario files, from a seed.

Everybody follows by IDM, cars change lanes by MOBIL, and the robot in the ego follows by IDM, too,
and keeps its lane. Desired speeds lie around the limits of each class, those of trucks at the
German 80 km/h; where they come from nowhere else the figures are our own.
"""

from __future__ import annotations

from typing import Any

from twin.scenario.free_driving.chance import Draws
from twin.scenario.free_driving.classes import MOTORWAY, STREET, RoadClass

ROBOT = {"time_gap_s": 1.8, "deceleration_mps2": 1.5, "changes_lanes": False}
"""The driver model of the robot: an attentive driver who keeps more than the usual 1.5 s."""
_TRUCK_MPS = 22.2
_AHEAD_M = 900.0
"""Vehicles ahead begin within this distance [m]."""
_BEHIND_M = (45.0, 90.0)
_RESERVE = 1.6
"""A case may take so many times as long as at the ego's desired speed."""

Scenario = dict[str, Any]


def scenario_file(road_class: RoadClass, road: str, name: str, seed: int) -> Scenario:
    """A scenario of a class in plain data, as its file has it.

    Args:
        road_class: the class.
        road: name or path of its road.
        name: of the scenario; another one is other traffic.
        seed: of the part.
    """
    draws = Draws(seed, f"{name} traffic")
    lane = 1 + int(draws.share() * road_class.lanes)
    wish_mps = draws.between(*road_class.speed_mps[lane - 1])
    actors: dict[str, Any] = {}
    slowest = wish_mps
    for other in range(1, road_class.lanes + 1):
        slowest = min(slowest, _same_way(road_class, draws, lane, other, wish_mps, actors))
    _oncoming(road_class, draws, actors)
    if road_class is STREET:
        _parked(road_class, draws, actors)
        _people(road_class, draws, actors)
    end_m = road_class.begin_m + road_class.drive_m
    events = _slowing(draws, lane, actors)
    return {
        "scenario": name,
        "road": road,
        "ego": {
            "lane": lane,
            "s_m": road_class.begin_m,
            "speed_mps": round(0.95 * slowest, 2),
            "behaviour": "idm",
            "idm": {"desired_speed_mps": wish_mps, **ROBOT},
        },
        "actors": actors,
        **({"events": events} if events else {}),
        "end": {
            "after_s": round(_RESERVE * road_class.drive_m / wish_mps, 1),
            "ego_reaches": {"s_m": end_m, "lane": lane},
        },
    }


def _same_way(
    road_class: RoadClass,
    draws: Draws,
    own_lane: int,
    lane: int,
    wish_mps: float,
    actors: dict[str, Any],
) -> float:
    """Vehicles ahead of the ego and behind it in a lane; the speed of the next one ahead in the
    ego's, else a high one."""
    first_mps = 100.0
    s_m = road_class.begin_m
    gaps_m = {"motorway": (55.0, 220.0), "rural": (70.0, 320.0)}.get(road_class.name, (40.0, 220.0))
    for number in range(5):
        s_m += draws.between(*gaps_m)
        if s_m > road_class.begin_m + _AHEAD_M or (road_class is STREET and number > 2):
            break
        kind = _kind(draws, road_class, lane)
        speed_mps = _speed(draws, road_class, kind, lane)
        if lane == own_lane and number == 0:
            first_mps = speed_mps
        actors[f"ahead_{lane}_{number + 1}"] = _vehicle(road_class, kind, lane, s_m, speed_mps)
    if draws.happens(0.7):
        s_m = road_class.begin_m - draws.between(*_BEHIND_M)
        speed_mps = min(_speed(draws, road_class, "car", lane), wish_mps, first_mps)
        if lane != own_lane or s_m > 10.0:
            actors[f"behind_{lane}"] = _vehicle(road_class, "car", lane, max(s_m, 10.0), speed_mps)
    return first_mps


def _slowing(draws: Draws, lane: int, actors: dict[str, Any]) -> dict[str, Any]:
    """In half of the cases the next one ahead slows down by up to 2 m/s^2, for a reason that nobody
    sees, and drives on: the robot follows without haste."""
    lead = f"ahead_{lane}_1"
    if lead not in actors or not draws.happens(0.5):
        return {}
    slow_mps = round(actors[lead]["speed_mps"] * draws.between(0.4, 0.8, 0.01), 2)
    slows = {"speed_mps": slow_mps, "at_mps2": draws.between(0.8, 2.0)}
    # A driver model that is in charge ends a change of speed at once, so it is taken away before.
    return {
        "minds": {"at_s": draws.between(5.0, 25.0), "do": {lead: {"behaviour": "none"}}},
        "slows": {"after": "minds", "do": {lead: slows}},
        "goes_on": {
            "after": "slows",
            "delay_s": draws.between(0.0, 4.0),
            "do": {lead: {"behaviour": "idm"}},
        },
    }


def _oncoming(road_class: RoadClass, draws: Draws, actors: dict[str, Any]) -> None:
    for lane in range(1, road_class.lanes + 1):
        s_m, number = road_class.begin_m + 150.0, 0
        while s_m < road_class.length_m - 60.0 and number < 5:
            number += 1
            kind = _kind(draws, road_class, lane)
            speed_mps = _speed(draws, road_class, kind, lane)
            body = _vehicle(road_class, kind, lane, s_m, speed_mps)
            actors[f"oncoming_{lane}_{number}"] = {**body, "oncoming": True}
            s_m += draws.between(120.0, 0.4 * road_class.length_m)


def _kind(draws: Draws, road_class: RoadClass, lane: int) -> str:
    if lane == 1 and draws.happens(0.4 if road_class is MOTORWAY else 0.15):
        return draws.one_of(("truck", "truck", "bus"))
    return draws.one_of(("car", "car", "car", "car", "van", "motorcycle"))


def _speed(draws: Draws, road_class: RoadClass, kind: str, lane: int) -> float:
    if road_class is MOTORWAY and kind in ("truck", "bus"):
        return _TRUCK_MPS + draws.between(-0.5, 1.0)
    low, high = road_class.speed_mps[lane - 1]
    return draws.between(low - 2.0, high + 1.0)


def _vehicle(
    road_class: RoadClass, kind: str, lane: int, s_m: float, speed_mps: float
) -> dict[str, Any]:
    idm: dict[str, Any] = {"desired_speed_mps": round(speed_mps, 2)}
    if kind in ("truck", "bus") or road_class is not MOTORWAY:
        idm["changes_lanes"] = False
    if kind in ("truck", "bus"):
        idm["acceleration_mps2"] = 0.8
    return {
        "kind": kind,
        "lane": lane,
        "s_m": round(s_m, 1),
        "speed_mps": round(speed_mps, 2),
        "behaviour": "idm",
        "idm": idm,
    }


def _parked(road_class: RoadClass, draws: Draws, actors: dict[str, Any]) -> None:
    """Cars and vans in the parking lanes along the ego's way."""
    for side in ("right", "left"):
        s_m = road_class.begin_m + draws.between(15.0, 60.0)
        for number in range(7):
            if s_m > road_class.begin_m + road_class.drive_m + 40.0:
                break
            kind = draws.one_of(("car", "car", "car", "van"))
            actors[f"parked_{side}_{number + 1}"] = {
                "kind": kind,
                "parked": side,
                "s_m": round(s_m, 1),
                "oncoming": side == "left",
            }
            s_m += draws.one_of((6.3, 6.6, 7.0, draws.between(20.0, 160.0)))


def _people(road_class: RoadClass, draws: Draws, actors: dict[str, Any]) -> None:
    """Pedestrians on the footways and a cyclist who comes towards the ego."""
    for number in range(4):
        kind = draws.one_of(("pedestrian", "pedestrian", "child"))
        footway = draws.one_of(("right", "left"))
        s_m = road_class.begin_m + draws.between(30.0, road_class.drive_m)
        beside = [other for other in actors.values() if other.get("footway") == footway]
        while any(abs(s_m - other["s_m"]) < 1.0 for other in beside):
            s_m = round(s_m + 1.0, 1)  # nobody starts in somebody else
        actors[f"walker_{number + 1}"] = {
            "kind": kind,
            "footway": footway,
            "s_m": s_m,
            "offset_m": draws.between(-0.7, 0.7),
            "oncoming": draws.happens(0.5),
            "speed_mps": draws.between(0.9, 1.6),
        }
    actors["cyclist"] = {
        "kind": "bicycle",
        "lane": 1,
        "oncoming": True,
        "offset_m": -1.1,
        "s_m": road_class.begin_m + draws.between(100.0, 140.0),
        "speed_mps": draws.between(3.5, 6.0),
    }
