"""Saves what was played as a file for the viewer, see :mod:`schemas.files.played_scenario`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from schemas.files.played_scenario import (
    NOTES_MAX,
    PATHS_MAX,
    PLAY_SUFFIX,
    PLAY_VERSION,
    POSES_MAX,
    TEXT_CHARS_MAX,
    BodyCategory,
    PlayElement,
    PlayEntity,
    PlayFile,
    PlayPath,
    PlayTransition,
    StoryLevel,
    StoryTransition,
)
from twin.play.drawn_paths import BegunAction, drawn_paths
from twin.play.drawn_roads import PATH_POINTS_MAX, Box, DrawnRoads, drawn_roads
from twin.play.playing import PlayedScenario, PoseRow
from twin.play.report import NamedPlay, element_path
from twin.records.play_file import POINT_BYTES, packed_rows, write_play
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.program.conditions import ElementState, Trigger
from twin.scenario.storyboard.program.program import ElementKind, Program, StoryElement

_TRANSITIONS: dict[ElementState, StoryTransition] = {
    ElementState.START_TRANSITION: "start",
    ElementState.END_TRANSITION: "end",
    ElementState.STOP_TRANSITION: "stop",
    ElementState.SKIP_TRANSITION: "skip",
}

Poses = dict[str, np.ndarray]
"""Poses by name of the entity [N, 6]."""


def save_played(
    path: Path, played: PlayedScenario, step_s: float, remarks: Sequence[str] = ()
) -> None:
    """Write what was played.

    Args:
        path: the file, which is replaced.
        played: what happened.
        step_s: step of the player [s].
        remarks: what else there is to say of it, e.g. what of its file has no effect.

    Raises:
        UsageError: it is larger than a limit of the format, or the file cannot be written.
    """
    write_play(path, to_play(played, step_s, remarks))


def save_plays(out: Path, plays: Sequence[NamedPlay], step_s: float) -> list[Path]:
    """Write plays: to the file ``out`` of one permutation, into the folder ``out`` of several.

    Raises:
        OSError: the folder cannot be made.
        UsageError: as :func:`save_played`.
    """
    paths = [out]
    if len(plays) != 1:
        out.mkdir(parents=True, exist_ok=True)
        paths = [out / f"{play.name}{PLAY_SUFFIX}" for play in plays]
    for path, play in zip(paths, plays, strict=True):
        save_played(path, play.played, step_s, play.notes)
    return paths


def to_play(played: PlayedScenario, step_s: float, remarks: Sequence[str] = ()) -> PlayFile:
    """What the viewer shows of what was played; as :func:`save_played`."""
    program = played.program
    times = sorted({row.time_s for row in played.rows})
    # Differences of times are not round; poses are kept at whole steps.
    period_s = step_s * max(1, round(min(np.diff(times), default=step_s) / step_s))
    poses, notes = _poses(played.rows, program, period_s)
    roads = RoadMap(program.network) if program.network is not None else None
    drawn = drawn_roads(roads, _box(poses)) if roads is not None else DrawnRoads([], [], [])
    paths = _bounded(drawn_paths(program, roads, list(_begun(played, poses, step_s))), notes)
    return PlayFile(
        version=PLAY_VERSION,
        name=_cut(program.name),
        step_s=step_s,
        period_s=period_s,
        end_s=played.steps * step_s,
        finished=played.finished,
        entities=list(_entities(program, poses)),
        lanes=drawn.lanes,
        marks=drawn.marks,
        paths=paths,
        elements=list(_elements(program)),
        transitions=[
            PlayTransition(
                time_s=item.step * step_s,
                element=item.element,
                transition=_TRANSITIONS[item.state],
            )
            for item in played.transitions
        ],
        notes=_notes([*notes, *drawn.notes, *played.overflows, *remarks]),
    )


def _poses(rows: list[PoseRow], program: Program, period_s: float) -> tuple[Poses, list[str]]:
    columns: dict[str, list[tuple[float, ...]]] = {entity.name: [] for entity in program.entities}
    share = -(-len(rows) // POSES_MAX)
    for row in rows:
        if share > 1 and round(row.time_s / period_s) % share:
            continue
        columns[row.entity].append(
            (row.time_s, row.x_m, row.y_m, row.z_m, row.heading_rad, row.speed_mps)
        )
    poses = {name: np.array(values, float).reshape(-1, 6) for name, values in columns.items()}
    return poses, [f"one of {share} poses is kept: there are too many"] if share > 1 else []


def _box(poses: Poses) -> Box:
    """Around everywhere an entity was."""
    places = np.concatenate([rows[:, 1:3] for rows in poses.values()] or [np.empty((0, 2))])
    if not len(places):
        return 0.0, 0.0, 0.0, 0.0
    (west, south), (east, north) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    return west, south, east, north


def _bounded(paths: list[PlayPath], notes: list[str]) -> list[PlayPath]:
    """The first paths, as many as a file may hold beside the roads; a note if that is not all."""
    sizes = np.cumsum([len(path.points) // POINT_BYTES for path in paths])
    kept = min(int(np.searchsorted(sizes, PATH_POINTS_MAX, "right")), PATHS_MAX)
    if kept < len(paths):
        notes.append(
            f"{len(paths) - kept} trajectories and routes are not drawn: there are too many"
        )
    return paths[:kept]


def _entities(program: Program, poses: Poses) -> Iterator[PlayEntity]:
    for entity in program.entities:
        box = entity.box
        yield PlayEntity(
            name=_cut(entity.name),
            category=cast(BodyCategory, entity.category.name.lower()),
            ego=entity.ego,
            length_m=box.length_m,
            width_m=box.width_m,
            height_m=box.height_m,
            centre_m=(box.centre_x_m, box.centre_y_m, box.centre_z_m),
            poses=packed_rows(poses[entity.name]),
        )


def _elements(program: Program) -> Iterator[PlayElement]:
    for number, element in enumerate(program.elements):
        action = "" if element.action is None else _words(type(element.action).__name__)
        yield PlayElement(
            level=cast(StoryLevel, element.kind.name.lower()),
            name=_cut(element.name),
            path=_cut(element_path(program, number)),
            line=element.line,
            action=action,
            trigger=_cut(_trigger(element.start)),
            actors=list(_actors(program, element)),
        )


def _actors(program: Program, element: StoryElement) -> tuple[int, ...]:
    """Actors of the group that an element is or lies in."""
    while element.kind is not ElementKind.GROUP and element.parent >= 0:
        element = program.elements[element.parent]
    return element.actors if element.kind is ElementKind.GROUP else ()


def _begun(played: PlayedScenario, poses: Poses, step_s: float) -> Iterator[BegunAction]:
    """Actions that began, with the poses of their actors, those of Init first."""
    program = played.program
    for init in program.init:
        if init.actor >= 0:
            yield BegunAction(init.action, init.actor, _pose(program, poses, init.actor, 0.0))
    for item in played.transitions:
        element = program.elements[item.element]
        if element.action is None or item.state is not ElementState.START_TRANSITION:
            continue
        for actor in _actors(program, element):
            pose = _pose(program, poses, actor, item.step * step_s)
            yield BegunAction(element.action, actor, pose)


def _pose(
    program: Program, poses: Poses, actor: int, time_s: float
) -> tuple[float, float, float, float]:
    """Pose in the last row up to a time, or else in the first."""
    rows = poses[program.entities[actor].name]
    if not len(rows):
        return 0.0, 0.0, 0.0, 0.0
    number = int(np.searchsorted(rows[:, 0], time_s + 1e-9, "right")) - 1
    x, y, z, heading = rows[max(number, 0), 1:5].tolist()
    return x, y, z, heading


def _notes(notes: list[str]) -> list[str]:
    return [_cut(note) for note in dict.fromkeys(notes)][:NOTES_MAX]


def _trigger(trigger: Trigger | None) -> str:
    groups = () if trigger is None else trigger.groups
    return " or ".join(" and ".join(condition.name for condition in group) for group in groups)


def _words(class_name: str) -> str:
    """``LaneChangeAction`` -> ``lane change``."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", class_name.removesuffix("Action")).lower()


def _cut(text: str) -> str:
    return text[:TEXT_CHARS_MAX]
