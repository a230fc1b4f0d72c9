"""Rows of a rulebook as points of a campaign: axes with values, and what is wrong with them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
from msgspec import UNSET

from schemas.axes import NUMBER_AXES, axes_allowed, is_axis
from schemas.kinds.scenario import kind_of, scenario_kinds
from schemas.sections.rulebook import Axis, Rulebook, RulebookRow
from schemas.sections.scenario import Scenario
from schemas.sections.trial import Trial, in_kmh
from schemas.validation import Mistake, suggest

ROW_AXIS = "row"
"""Axis of the rows of a rulebook, by their names."""
REPEAT_AXIS = "repeat"
"""Axis of a row's repetitions, from 0."""

Point = dict[str, Any]


def prefix_of(scenario: Scenario) -> str:
    """How the axes begin that are numbers of the scenario's file."""
    return next(prefix for prefix, kind in NUMBER_AXES.items() if kind.name == scenario.type)


def points_of_row(row: RulebookRow, prefix: str) -> Iterator[Point]:
    """The points of a row as it is written, without repetitions and matrix.

    Args:
        row: the row.
        prefix: of numbers, :func:`prefix_of`.
    """
    names = list(row.values)
    lists = [row.listed(name) for name in names]
    if row.zipped:
        longest = max(map(len, lists), default=1)
        lists = [values * longest if len(values) == 1 else values for values in lists]
        combined: Iterator[tuple[Any, ...]] = zip(*lists, strict=True) if lists else iter([()])
    else:
        combined = itertools.product(*lists)
    for values in combined:
        numbers = {prefix + name: value for name, value in zip(names, values, strict=True)}
        yield {ROW_AXIS: row.row, **row.conditions, **numbers}


def grid_of_rows(
    rulebook: Rulebook, scenario: Scenario, matrix: Mapping[str, Sequence[Axis]]
) -> Iterator[tuple[str, Point]]:
    """Where each row stands in the file, and each of its points: values, then the matrix, then
    repetitions, the last fastest."""
    prefix = prefix_of(scenario)
    for index, row in enumerate(rulebook.rows):
        for point in points_of_row(row, prefix):
            for values in itertools.product(*matrix.values()):
                further = dict(zip(matrix, values, strict=True))
                for repeat in range(row.repetitions):
                    repetition = {REPEAT_AXIS: repeat} if row.repetitions > 1 else {}
                    yield f"rulebook.rows[{index}]", {**point, **further, **repetition}


def axes_of_rows(rulebook: Rulebook, scenario: Scenario) -> list[str]:
    """Axes that the rows of a rulebook set, in file order; rows themselves first."""
    prefix = prefix_of(scenario)
    named = [
        axis
        for row in rulebook.rows
        for axis in (*row.conditions, *(prefix + name for name in row.values))
    ]
    return [*dict.fromkeys([ROW_AXIS, *named])]


def axes_beyond(
    rulebook: Rulebook,
    scenario: Scenario,
    matrix: Mapping[str, Sequence[Axis]],
    cases: Sequence[Mapping[str, Axis]],
) -> list[str]:
    """Axes by which cases differ beside what their rows say and repetitions: those of the matrix,
    also where single points of it are listed as cases."""
    of_rows = {REPEAT_AXIS, *axes_of_rows(rulebook, scenario)}
    named = [*matrix, *(axis for case in cases for axis in case)]
    return [axis for axis in dict.fromkeys(named) if axis not in of_rows]


def constants_of_row(row: RulebookRow, prefix: str) -> Point:
    """Axes that have one value in all of the row, which its name stands for."""
    singles = {n: row.listed(n)[0] for n in row.values if len(row.listed(n)) == 1}
    return {**row.conditions, **{prefix + name: value for name, value in singles.items()}}


def with_file(scenario: Scenario, row: RulebookRow) -> Scenario:
    """The scenario of a campaign with the file of a row."""
    if not row.storyboard:
        return scenario
    return msgspec.structs.replace(scenario, **{kind_of(scenario).brings_scene: row.storyboard})


def trial_of_point(scenario: Scenario, row: RulebookRow, point: Point) -> Trial:
    """The trial of a row with the speeds that one of its points says, as it is written."""
    prefix = prefix_of(scenario)
    numbers = getattr(scenario, kind_of(scenario).numbers)
    numbers = {} if numbers is UNSET else dict(numbers)
    numbers |= {a.removeprefix(prefix): v for a, v in point.items() if a.startswith(prefix)}
    trial = row.trial
    speeds = {}
    for key, name in (
        ("speed_kmh", trial.speed_number),
        ("target_speed_kmh", trial.target_speed_number),
    ):
        value = numbers.get(name)
        if getattr(trial, key) is None and isinstance(value, int | float):
            speeds[key] = in_kmh(name, value)
    return msgspec.structs.replace(trial, row=row.row, **speeds)


def rulebook_mistakes(
    rulebook: Rulebook,
    scenario: Scenario,
    matrix: Mapping[str, Sequence[Axis]],
    cases: Sequence[Mapping[str, Axis]],
) -> list[Mistake]:
    """What is wrong with a rulebook beside the types of its values."""
    kind = kind_of(scenario)
    if not kind.trial:
        able = [other.name for other in scenario_kinds().declared if other.trial]
        problem = f"{scenario.type} has no trials; for a rulebook take {', '.join(able)}"
        return [Mistake("scenario.type", problem)]
    mistakes = []
    if getattr(scenario, kind.trial) is not UNSET:
        both = "the rows of the rulebook have trials; leave it away"
        mistakes.append(Mistake(f"scenario.{kind.trial}", both))
    if matrix and cases:
        either = "with a rulebook, cases name single points of it; give a matrix or cases, not both"
        mistakes.append(Mistake("cases", either))
    mistakes += [
        Mistake(f"matrix.{axis}", "the rows of the rulebook say it; leave it away")
        for axis in (ROW_AXIS, REPEAT_AXIS)
        if axis in matrix
    ]
    names = [row.row for row in rulebook.rows]
    mistakes += [
        Mistake(f"cases[{index}].{ROW_AXIS}", f"missing; choose of {', '.join(names)}")
        for index, case in enumerate(cases)
        if ROW_AXIS not in case
    ]
    prefix = prefix_of(scenario)
    allowed = axes_allowed()
    for index, row in enumerate(rulebook.rows):
        where = f"rulebook.rows[{index}]"
        if names.index(row.row) != index:
            mistakes.append(Mistake(f"{where}.row", f"'{row.row}' is the name of another row"))
        if row.group and row.group not in rulebook.groups:
            hint = suggest(row.group, list(rulebook.groups)) if rulebook.groups else "it has none"
            mistakes.append(Mistake(f"{where}.group", f"no group '{row.group}'; {hint}"))
        mistakes += _row_mistakes(row, where, scenario, allowed)
        mistakes += [
            Mistake(f"matrix.{axis}", f"row '{row.row}' of the rulebook sets it, too")
            for axis in matrix
            if axis in row.conditions or axis.removeprefix(prefix) in row.values
        ]
    return mistakes


def _row_mistakes(
    row: RulebookRow, where: str, scenario: Scenario, allowed: list[str]
) -> Iterator[Mistake]:
    lengths = {name: len(row.listed(name)) for name in row.values}
    for name in row.values:
        values = row.listed(name)
        if not values:
            yield Mistake(f"{where}.values.{name}", "an empty list; give at least one value")
        elif len(set(values)) != len(values) and not row.zipped:
            yield Mistake(f"{where}.values.{name}", "a value appears twice; list each once")
    if row.zipped and len({length for length in lengths.values() if length != 1}) > 1:
        shown = ", ".join(f"{name} {length}" for name, length in lengths.items())
        yield Mistake(f"{where}.values", f"zipped lists are equally long, given {shown}")
        return  # it has no points
    no_conditions = {
        ROW_AXIS: "the row has its name",
        REPEAT_AXIS: "give repetitions",
        "scenario.storyboard": "give storyboard",
    }
    for axis in row.conditions:
        if axis in no_conditions:
            yield Mistake(f"{where}.conditions.{axis}", f"no condition; {no_conditions[axis]}")
        elif axis.startswith(tuple(NUMBER_AXES)):
            yield Mistake(f"{where}.conditions.{axis}", "a number of the file; give it in values")
        elif not is_axis(axis, allowed):
            problem = f"unknown axis; {suggest(axis, allowed)}"
            yield Mistake(f"{where}.conditions.{axis}", problem)
    for name, (low, high) in row.varied.items():
        if low > high:
            yield Mistake(f"{where}.varied.{name}", f"given [{low:g}, {high:g}]; the lower first")
        elif base_of_varied(row, name, scenario) is None:
            problem = "neither one of `values` nor an axis with a number to which it could be added"
            yield Mistake(f"{where}.varied.{name}", problem)
    yield from _trial_mistakes(row, where, scenario)


def _trial_mistakes(row: RulebookRow, where: str, scenario: Scenario) -> Iterator[Mistake]:
    """Planned speeds that nobody says, and tables that end below one."""
    prefix = prefix_of(scenario)
    for point in points_of_row(row, prefix):
        if any(not isinstance(value, int | float | str) for value in point.values()):
            return  # said where lists are looked at
        trial = trial_of_point(scenario, row, point)
        if trial.speed_kmh is None:
            name = trial.speed_number
            yield Mistake(
                f"{where}.trial.speed_kmh",
                f"missing; give the planned speed of the ego, or '{name}' in values, or the name "
                "of another number in speed_number",
            )
            return
        at = trial.speed_kmh if trial.table_speed == "subject" else trial.closing_kmh
        if trial.impact_kmh and at is not None and at > trial.impact_kmh[-1][0]:
            last = trial.impact_kmh[-1][0]
            problem = f"its last speed is {last:g} km/h, the row has {at:g} km/h"
            yield Mistake(f"{where}.trial.impact_kmh", problem)
            return


def base_of_varied(row: RulebookRow, name: str, scenario: Scenario) -> str | None:
    """The axis to which a repetition adds what it draws for ``name``; None: there is none."""
    prefix = prefix_of(scenario)
    if name in row.values:
        return prefix + name
    value = row.conditions.get(name)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return name
    section, _, field = name.partition(".")
    if section == "scenario" and is_axis(name, axes_allowed()):
        default = getattr(scenario, field, None)
        if isinstance(default, int | float) and not isinstance(default, bool):
            return name
    return None


def rows_called(rulebook: Rulebook, words: Sequence[str]) -> list[str]:
    """Names of the rows that are called by their own names, their groups, their tests or tags of
    their groups, in the order of the rulebook; capital letters do not matter.

    Raises:
        ValueError: nothing is called so; one line.
    """
    tags = {name: [tag.lower() for tag in group.tags] for name, group in rulebook.groups.items()}
    called = {
        row.row: {row.row.lower(), row.group.lower(), row.test.lower(), *tags.get(row.group, ())}
        - {""}
        for row in rulebook.rows
    }
    known = [*dict.fromkeys([*called, *rulebook.groups, *itertools.chain(*tags.values())])]
    chosen = set()
    for word in words:
        rows = [row for row, names in called.items() if word.strip().lower() in names]
        if not rows:
            raise ValueError(f"no row, group, test or tag '{word}'; {suggest(word.lower(), known)}")
        chosen.update(rows)
    return [row for row in called if row in chosen]


def rows_given(data: Any) -> int:
    """Cases of a rulebook in plain data for one point of a matrix, by lengths alone; what is not
    as it should be is a mistake that others tell."""
    rows = data.get("rows") if isinstance(data, dict) else None
    return sum(_row_given(row) for row in rows) if isinstance(rows, list) else 0


def _row_given(row: Any) -> int:
    if not isinstance(row, dict):
        return 0
    values, repetitions = row.get("values"), row.get("repetitions", 1)
    lists = values.values() if isinstance(values, dict) else ()
    lengths = [len(value) for value in lists if isinstance(value, list)]
    count = repetitions if isinstance(repetitions, int) else 1
    for length in [max(lengths, default=1)] if row.get("zipped") is True else lengths:
        count *= length
    return count
