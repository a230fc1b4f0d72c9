"""The points of a campaign: what each one of its matrix or list makes of the sections."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import msgspec
from msgspec import UNSET, UnsetType

from schemas.axes import (
    Memo,
    case_id,
    objects_of,
    parameters_of,
    scenario_of,
    section_of,
    sensors_of,
    value_of,
)
from schemas.campaign import ID_CHARS_MAX, Campaign
from schemas.identity import stream_key
from schemas.kinds.scenario import kind_of
from schemas.kinds.sensor import sensor_kinds
from schemas.names import minutes
from schemas.rulebook_rows import (
    REPEAT_AXIS,
    ROW_AXIS,
    base_of_varied,
    constants_of_row,
    grid_of_rows,
    prefix_of,
    trial_of_point,
    with_file,
)
from schemas.searching.search_points import probes, search_grid
from schemas.sections.autonomy import Autonomy
from schemas.sections.camera import Camera
from schemas.sections.environment import Environment
from schemas.sections.objects import ObjectVariation
from schemas.sections.repeated import DRAWN_AS, DRAWN_AS_ALLOWED, Repeated, repeated_of
from schemas.sections.rulebook import RulebookRow
from schemas.sections.scenario import Scenario
from schemas.sections.sensors import Sensors
from schemas.validation import MISTAKES_MAX, Mistake, suggest

DRAWN_DIGITS = 6
"""Digits behind the point of a value that a repetition has drawn."""


class Point(NamedTuple):
    """One case as its axes decide it: the part that is slow to find out.

    The rest of a case is the same for all cases of a campaign, see :mod:`schemas.plan`.
    """

    id: str
    """Id of its case."""
    values: dict[str, Any]
    """Axis -> value, as the file has them."""
    model: str
    time_of_day_min: int
    weather: str
    repeat: int
    scenario: Scenario
    camera: Camera
    sensors: Sensors
    sensor_hz: dict[str, int]
    """Rates of the vehicle's own sensors that are there, by name [Hz]."""
    environment: Environment
    autonomy: Autonomy
    """Only what an axis may name of it is read: :data:`schemas.sections.autonomy.DELAYS`."""
    parameters: dict[str, Any]
    """Parameters of the stack that axes name."""
    objects: dict[str, ObjectVariation]
    row: str = ""
    """Its row of the rulebook; empty: there is no rulebook."""
    repeats: Repeated | UnsetType = UNSET
    """The case of another campaign that it repeats; unset: none."""


def points_of(campaign: Campaign) -> tuple[list[Point], list[Mistake]]:
    """Every point in file order, those with mistakes left out, and the mistakes."""
    kept, mistakes = _grid(campaign)
    points: dict[str, Point] = {}
    memos: dict[str, Memo] = {}
    for where, given_name, values in kept:
        row, point_mistakes = _row(campaign, values, where)
        # Another row is another scenario, of which the same value of an axis makes another.
        memo = memos.setdefault(row.row if row else "", {})
        point = None
        if not point_mistakes:
            point, point_mistakes = _point(campaign, values, where, memo, row, given_name)
        mistakes += [m for m in point_mistakes if m not in mistakes]
        if len(mistakes) > MISTAKES_MAX:
            mistakes[MISTAKES_MAX:] = [Mistake("", "and more; correct these first")]
            break
        if point is None:
            continue
        if point.id in points:
            mistakes.append(Mistake(where, f"case '{point.id}' appears twice"))
        points[point.id] = point
    if not kept and not mistakes:
        mistakes.append(Mistake("exclude", "every case is excluded; nothing is left to run"))
    return list(points.values()), mistakes


def probe_mistakes(campaign: Campaign) -> list[Mistake]:
    """What is wrong with points at the ends of the distributions of a search, before any point is
    proposed; a mistake per parameter."""
    assert campaign.search is not UNSET
    mistakes: dict[str, Mistake] = {}
    memo: Memo = {}
    for where, values in probes(campaign.search, campaign.matrix):
        _, wrong = _point(campaign, values, where, memo, None, "probe")
        for mistake in wrong:
            mistakes.setdefault(where, Mistake(where, mistake.message))
    return list(mistakes.values())


def _grid(campaign: Campaign) -> tuple[list[tuple[str, str, dict[str, Any]]], list[Mistake]]:
    """Where each case stands in the file, its name (empty: its values say it), and its values; in
    file order."""
    if campaign.search is not UNSET:
        return list(search_grid(campaign.search, campaign.matrix)), []
    points: list[tuple[str, dict[str, Any]]] = []
    if campaign.rulebook is not UNSET:
        if not campaign.cases:
            points += grid_of_rows(campaign.rulebook, campaign.scenario, campaign.matrix)
    elif campaign.matrix:
        for values in itertools.product(*campaign.matrix.values()):
            points.append(("matrix", dict(zip(campaign.matrix, values, strict=True))))
    excluded = [False] * len(campaign.exclude)
    kept = []
    for where, point in points:
        hits = [
            index
            for index, pattern in enumerate(campaign.exclude)
            if all(axis in point and point[axis] == value for axis, value in pattern.items())
        ]
        for index in hits:
            excluded[index] = True
        if not hits:
            kept.append((where, "", point))
    mistakes = [
        Mistake(f"exclude[{index}]", "matches no case of the matrix; correct or remove it")
        for index, hit in enumerate(excluded)
        if not hit
    ]
    for index, point in enumerate(campaign.cases):
        repeated = repeated_of(point)
        if DRAWN_AS in point and repeated is UNSET:
            mistakes.append(Mistake(f"cases[{index}].{DRAWN_AS}", DRAWN_AS_ALLOWED))
        name = "" if repeated is UNSET else repeated.name
        kept.append((f"cases[{index}]", name, dict(point)))
    return kept, mistakes


def _model(campaign: Campaign, point: dict[str, Any], where: str) -> tuple[str, list[Mistake]]:
    """The perception variant of a point of the matrix; where there is but one it need not say."""
    variants = campaign.autonomy.perception
    choice = point.get("model", next(iter(variants)) if len(variants) == 1 else None)
    path, model = f"{where}.model", str(choice)
    if choice is None:
        return model, [Mistake(path, f"missing; choose of {', '.join(variants)}")]
    if model not in variants:
        return model, [Mistake(path, f"given {choice!r}; {suggest(model, list(variants))}")]
    return model, []


def _row(
    campaign: Campaign, point: dict[str, Any], where: str
) -> tuple[RulebookRow | None, list[Mistake]]:
    """The row of the rulebook that a point is one of."""
    if campaign.rulebook is UNSET:
        return None, []
    name = point.get(ROW_AXIS)
    row = campaign.rulebook.row(name) if isinstance(name, str) else None
    if row is None:
        names = [row.row for row in campaign.rulebook.rows]
        return None, [
            Mistake(f"{where}.{ROW_AXIS}", f"given {name!r}; {suggest(str(name), names)}")
        ]
    if not isinstance(point.get(REPEAT_AXIS, 0), int):
        return row, []  # said where its value is looked at
    return row, _range_mistakes(campaign, row, point, where)


def _range_mistakes(
    campaign: Campaign, row: RulebookRow, point: dict[str, Any], where: str
) -> list[Mistake]:
    """Ends of the ranges from which a row's repetitions draw, where they are not allowed."""
    if point.get(REPEAT_AXIS, 0) != 0:
        return []
    mistakes = list[Mistake]()
    for name, ends in row.varied.items():
        for end in ends:
            _, wrong = _scenario(campaign, point, f"{where}.varied.{name}", {}, row, {name: end})
            mistakes += wrong
    return mistakes


def _scenario(
    campaign: Campaign,
    point: dict[str, Any],
    where: str,
    memo: Memo,
    row: RulebookRow | None,
    drawn: dict[str, float],
) -> tuple[Any, list[Mistake]]:
    """The scenario of a point; of a rulebook, with what its repetition adds to the row's values."""
    scenario = campaign.scenario
    if row is None:
        return scenario_of(scenario, point, where, memo)
    if not kind_of(scenario).trial:
        return None, []  # said where the rulebook is looked at
    changed = dict(point)
    before = dict[str, float]()
    for name, added in drawn.items():
        axis = base_of_varied(row, name, scenario)
        if axis is None:
            return None, []  # the same
        value = point.get(axis, getattr(scenario, axis.partition(".")[2], None))
        if isinstance(value, int | float):
            before[axis] = value
            changed[axis] = round(value + added, DRAWN_DIGITS)
    made, mistakes = scenario_of(with_file(scenario, row), changed, where, memo)
    if made is None:
        return None, mistakes
    trial = msgspec.structs.replace(trial_of_point(scenario, row, point), written=before)
    return msgspec.structs.replace(made, **{kind_of(scenario).trial: trial}), mistakes


def _drawn(
    seed: int, row: RulebookRow, point: dict[str, Any], shared: tuple[str, str, str]
) -> dict[str, float]:
    """What a repetition adds to the values of its row, by name; the first adds nothing.

    Uniform in each range; nothing but the seed, the row's name, the values of the point, the number
    of the repetition and the name of what is varied decides it.
    """
    repeat = point.get(REPEAT_AXIS, 0)
    if not repeat:
        return {}
    values = {axis: value for axis, value in point.items() if axis not in (ROW_AXIS, REPEAT_AXIS)}
    name = case_id(*shared, values, row.row)
    drawn = {}
    for varied, (low, high) in row.varied.items():
        share = stream_key(seed, name, f"repetition {repeat} of {varied}") / 2**64
        drawn[varied] = low + share * (high - low)
    return drawn


def _name(
    campaign: Campaign, row: RulebookRow | None, point: dict[str, Any], shared: tuple[str, str, str]
) -> str:
    """The name of a case; ``shared``: its perception variant, time and weather."""
    if row is None:
        return case_id(*shared, point)
    constants = constants_of_row(row, prefix_of(campaign.scenario))
    said = (ROW_AXIS, REPEAT_AXIS)
    rest = {
        axis: value
        for axis, value in point.items()
        if axis not in said and not (axis in constants and constants[axis] == value)
    }
    name = case_id(*shared, rest, row.row) if rest else row.row
    return f"{name}-r{point[REPEAT_AXIS]}" if REPEAT_AXIS in point else name


def _point(
    campaign: Campaign,
    point: dict[str, Any],
    where: str,
    memo: Memo,
    row: RulebookRow | None,
    given_name: str,
) -> tuple[Point | None, list[Mistake]]:
    model, mistakes = _model(campaign, point, where)
    time_of_day, axis_mistakes = value_of(point, "time_of_day", where, memo)
    mistakes += axis_mistakes
    weather, axis_mistakes = value_of(point, "weather", where, memo)
    mistakes += axis_mistakes
    known = campaign.environment.weathers()
    if weather is not None and weather not in known:
        problem = f"given {weather!r}; {suggest(weather, known)}"
        mistakes.append(Mistake(f"{where}.weather", problem))
    repeat, axis_mistakes = value_of(point, "repeat", where, memo)
    mistakes += axis_mistakes
    shared = (model, str(time_of_day), str(weather))
    name = given_name or _name(campaign, row, point, shared)
    drawn = _drawn(campaign.seed, row, point, shared) if row and repeat else {}
    scenario, axis_mistakes = _scenario(campaign, point, where, memo, row, drawn)
    mistakes += axis_mistakes
    camera, axis_mistakes = section_of(campaign.camera, "camera", point, where, memo)
    mistakes += axis_mistakes
    sensors, axis_mistakes = sensors_of(campaign.sensors, point, where, memo)
    mistakes += axis_mistakes
    environment, axis_mistakes = section_of(campaign.environment, "environment", point, where, memo)
    mistakes += axis_mistakes
    autonomy, axis_mistakes = section_of(campaign.autonomy, "autonomy", point, where, memo)
    mistakes += axis_mistakes
    objects, axis_mistakes = objects_of(campaign.objects, point, where, memo)
    mistakes += axis_mistakes
    if mistakes:
        return None, mistakes
    sensor_hz = sensors.rates(campaign.control_hz)
    mistakes = _rates(campaign, camera, sensor_hz, autonomy)
    if len(name) > ID_CHARS_MAX:
        problem = f"case '{name[:40]}...' would have a name of {len(name)} characters, at most"
        mistakes.append(Mistake(where, f"{problem} {ID_CHARS_MAX} are allowed; shorten its values"))
    if mistakes:
        return None, mistakes
    found_point = Point(
        id=name,
        values=point,
        model=model,
        time_of_day_min=minutes(time_of_day),
        weather=weather,
        repeat=repeat,
        scenario=scenario,
        camera=camera,
        sensors=sensors,
        sensor_hz=sensor_hz,
        environment=environment,
        autonomy=autonomy,
        parameters=parameters_of(point),
        objects=objects,
        row=row.row if row else "",
        repeats=repeated_of(point),
    )
    return found_point, []


def _rates(
    campaign: Campaign, camera: Camera, sensor_hz: dict[str, int], autonomy: Autonomy
) -> list[Mistake]:
    """Periods are whole physics steps of 2 ms, and sensors' rates divide the control rate."""
    mistakes = []
    control_hz = campaign.control_hz
    if 500 % control_hz:
        mistakes.append(
            Mistake("control_hz", f"given {control_hz}, allowed: a divisor of 500 (2 ms steps)")
        )
    rates = {}
    if campaign.render:  # without pictures nobody minds when they were due
        rates["camera"] = camera.hz
        rates.update((f"cameras[{i}]", more.hz) for i, more in enumerate(campaign.cameras))
    rates.update((f"lidars[{i}]", more.hz) for i, more in enumerate(campaign.lidars) if more.hz)
    rates.update((f"sensors.{name}", hz) for name, hz in sensor_hz.items())
    if autonomy.rate_hz and control_hz % autonomy.rate_hz:
        allowed = f"given {autonomy.rate_hz}, allowed: a divisor of control_hz {control_hz}"
        mistakes.append(Mistake("autonomy.rate_hz", allowed))
    mistakes += [
        Mistake(f"{name}.hz", f"given {hz}, allowed: a divisor of control_hz {control_hz}")
        for name, hz in rates.items()
        if hz > control_hz or control_hz % hz
    ]
    return mistakes + _parts(sensor_hz)


def _parts(sensor_hz: dict[str, int]) -> list[Mistake]:
    """Sensors that are made of another one's measurements need it, at a multiple of their rate."""
    mistakes = []
    for name, hz in sensor_hz.items():
        whole = sensor_kinds().find(name).part_of
        if whole and whole not in sensor_hz:
            problem = f"is made of what {whole} measures; add '{whole}: {{}}' to sensors"
            mistakes.append(Mistake(f"sensors.{name}", problem))
        elif whole and sensor_hz[whole] % hz:
            allowed = f"given {hz}, allowed: a divisor of sensors.{whole}.hz {sensor_hz[whole]}"
            mistakes.append(Mistake(f"sensors.{name}.hz", allowed))
    return mistakes
