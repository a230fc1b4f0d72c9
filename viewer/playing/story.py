"""What happened in a played scenario: a log of its elements, points where events began, and a
summary."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from schemas.escape import escape
from schemas.files.played_scenario import PlayElement, PlayFile
from schemas.words import counted
from twin.records.play_file import poses_of
from viewer.playing import paths
from viewer.playing.bodies import Presence, stamps
from viewer.playing.eyes import top_eyes
from viewer.playing.names import event_name
from viewer.recording.rows import EntityRows
from viewer.recording.scenery import BLUE, GREEN, GREY, ORANGE, RED, Color

NAME_CHARS = 80
"""Longest name or trigger in a line of the log [characters]."""
FIRED_MAX = 200
"""Events that are marked on the ground, the first ones."""
NOTES_SHOWN = 6
"""Notes of the summary."""
_VERBS = {"start": "begins", "end": "ends", "stop": "is stopped", "skip": "is skipped"}


def log_rows(play: PlayFile) -> EntityRows:
    """Transitions of elements and comings and goings of entities, in the order of time.

    Beside text, level and colour a row holds the element's path, level and line, and the
    transition, for programs.
    """
    lines = [*_transitions(play), *_comings(play)]
    # Entities come and go before elements change.
    lines.sort(key=lambda line: (line[0], line[3] != ""))
    times = np.array([line[0] for line in lines])
    texts, looks = [line[1] for line in lines], [line[2] for line in lines]
    columns = rr.TextLog.columns(
        text=texts, level=[level for level, _ in looks], color=[color for _, color in looks]
    )
    facts = rr.AnyValues.columns(
        element=[line[3] for line in lines],
        element_level=[line[4] for line in lines],
        transition=[line[5] for line in lines],
        line=[line[6] for line in lines],
    )
    return EntityRows(paths.EVENTS, *stamps(play, times), [*columns, *facts])


LogLine = tuple[float, str, tuple[str, Color], str, str, str, int]
"""Time [s], text, level and colour; path, level, transition and line of the element, if any."""


def _transitions(play: PlayFile) -> Iterator[LogLine]:
    for item in play.transitions:
        element = play.elements[item.element]
        text = f"{_named(play, element)} {_VERBS[item.transition]}"
        if item.transition == "start" and element.trigger:
            text += f" (trigger {escape(element.trigger, NAME_CHARS)})"
        look = _look(element, item.transition)
        path = escape(element.path)
        yield item.time_s, text, look, path, element.level, item.transition, element.line


def _named(play: PlayFile, element: PlayElement) -> str:
    if element.level == "storyboard":
        return "the storyboard"
    name = escape(element.name, NAME_CHARS)
    if element.level != "action":
        return f"{element.level} {name}"
    actors = ", ".join(escape(play.entities[i].name, NAME_CHARS) for i in element.actors[:3])
    more = ", ..." if len(element.actors) > 3 else ""
    return f"{actors}{more}{': ' if actors else ''}{escape(element.action, NAME_CHARS)} {name}"


def _look(element: PlayElement, transition: str) -> tuple[str, Color]:
    """Level and colour of a line: what fires stands out, frames of stories stay back."""
    cut = transition in ("stop", "skip")
    if element.level == "event":
        return ("WARN", RED) if cut else ("INFO", ORANGE if transition == "start" else GREEN)
    if element.level == "action":
        return ("WARN", RED) if cut else ("DEBUG", BLUE)
    if element.level in ("storyboard", "act"):
        return "INFO", GREY
    return "TRACE", GREY


def _comings(play: PlayFile) -> Iterator[LogLine]:
    """Entities that appear after the beginning, or vanish before the end."""
    for entity in play.entities:
        presence = Presence(play, poses_of(entity.poses))
        name = escape(entity.name, NAME_CHARS)
        for time_s in presence.begins_s.tolist():
            if time_s > 0.0:
                yield time_s, f"{name} appears", ("INFO", GREY), "", "", "", 0
        for time_s in presence.ends_s.tolist():
            yield time_s, f"{name} vanishes", ("INFO", GREY), "", "", "", 0


def fired(play: PlayFile, origin_m: np.ndarray) -> list[EntityRows]:
    """Points where the first actor of an event was when it began, unless that was at once, and
    their names in each view.

    Places are moved by ``-origin_m``.
    """
    names: dict[tuple[float, int], list[str]] = {}
    for item in play.transitions:
        element = play.elements[item.element]
        begins = element.level == "event" and item.transition == "start" and item.time_s > 0.0
        if begins and element.actors:
            names.setdefault((item.time_s, element.actors[0]), []).append(element.name)
    rows = []
    eyes = top_eyes(play, origin_m)
    count = 0
    for (time_s, actor), events in names.items():
        poses = poses_of(play.entities[actor].poses)
        number = int(np.searchsorted(poses[:, 0], time_s + 1e-9, "right")) - 1
        if number < 0 or count == FIRED_MAX:
            continue
        more = f" +{len(events) - 1}" if len(events) > 1 else ""
        text = f"{escape(events[0], 40)}{more} {time_s:.2f} s"
        place = poses[number, 1:4] - origin_m + np.array([0.0, 0.0, 0.1])
        stamped = stamps(play, np.array([time_s]))
        point = rr.Points3D.columns(
            positions=[place], radii=[rr.Radius.ui_points(4.0)], colors=[ORANGE]
        )
        rows.append(EntityRows(f"{paths.FIRED}/{count:03d}", *stamped, list(point)))
        for eye in eyes:
            path, name = event_name(count, text, place, play.entities[actor].width_m, eye)
            rows.append(EntityRows(path, *stamped, name))
        count += 1
    return rows


def summary(play: PlayFile) -> rr.TextDocument:
    """What was played, as a document."""
    egos = [entity.name for entity in play.entities if entity.ego]
    events = sum(
        item.transition == "start" and play.elements[item.element].level == "event"
        for item in play.transitions
    )
    how = "the storyboard ended" if play.finished else "it was still running"
    lines = [
        f"### {_plain(play.name)}",
        f"{play.end_s:.2f} s, {how}; {counted(len(play.entities), 'entity', 'entities')}, "
        f"{counted(events, 'event')} began",
        *([f"ego {_plain(', '.join(egos))}"] if egos else []),
        *(f"- {_plain(note)}" for note in play.notes[:NOTES_SHOWN]),
        *(
            [f"- and {len(play.notes) - NOTES_SHOWN} more notes"]
            if play.notes[NOTES_SHOWN:]
            else []
        ),
    ]
    return rr.TextDocument("\n\n".join(lines), media_type="text/markdown")


def _plain(text: str) -> str:
    """Untrusted text in a document: nothing of it is a heading, a link or emphasis."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]()#+-.!<>|~" else c for c in escape(text, 200))
