"""A played scenario as a recording, read back with Rerun's own reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from played_files import entity, line, played, straight
from recordings import read_recording
from rerun.chunk import RrdReader

from schemas.files.played_scenario import PlayElement, PlayMark, PlayTransition
from twin.base.errors import InfrastructureError
from viewer.playing import ground, paths, story
from viewer.playing.bodies import Presence
from viewer.playing.eyes import far_eye, top_eyes
from viewer.playing.recording import FAR_M, write_recording
from viewer.recording import naming

EGO, VAN, WALKER = "000-Ego", "001-van", "002-walker"


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    write_recording(played(), tmp_path / "s.rrd")
    return tmp_path / "s.rrd"


def rows(path: Path, entity_path: str) -> list[dict[str, Any]]:
    """Rows of one entity in order of time; ``time_s`` beside its components."""
    reader = RrdReader(path)
    table = []
    for chunk in reader.stream(store=reader.recordings()[0]):
        if str(chunk.entity_path).strip("/") != entity_path or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        times = batch.column(naming.SIM_TIME).cast(pa.int64()).to_pylist()
        columns = {name: batch.column(name).to_pylist() for name in batch.schema.names}
        for number, time_ns in enumerate(times):
            values = {name: column[number] for name, column in columns.items()}
            table.append({**values, "time_s": time_ns / 1e9})
    return sorted(table, key=lambda row: row["time_s"])


def test_what_a_recording_holds(recorded: Path) -> None:
    whole = read_recording(recorded)
    assert whole.application_id == paths.APP
    assert whole.blueprints == 1
    assert {paths.LANES, paths.MARKS, paths.PATHS, paths.SUMMARY} <= whole.static
    assert {f"{paths.SPEEDS}/{name}" for name in (EGO, VAN, WALKER)} <= whole.static
    about = whole.properties["play"]
    assert about["name"] == "by hand"
    assert about["end_s"] == 2.0
    assert whole.rows[f"{paths.ENTITIES}/{EGO}"] == 41
    assert whole.rows[f"{paths.SPEEDS}/{WALKER}"] == 14
    assert whole.rows[f"{paths.TRAILS}/{VAN}"] == 40
    assert f"{paths.TRAILS}/{WALKER}" not in whole.rows, "who stands leaves no trail"


def test_poses_speeds_and_times_are_those_of_the_file(recorded: Path) -> None:
    van = rows(recorded, f"{paths.ENTITIES}/{VAN}")
    assert [row["time_s"] for row in van[:3]] == [0.0, 0.05, 0.1]
    places = np.array([row["Transform3D:translation"][0] for row in van])
    assert np.allclose(places, straight(8.0, 20.0, 3.5)[:, 1:4], atol=1e-5)
    assert [row["tick"] for row in van[:3]] == [0, 5, 10]
    speeds = rows(recorded, f"{paths.SPEEDS}/{VAN}")
    assert {row["Scalars:scalars"][0] for row in speeds} == {8.0}
    assert [row["time_s"] for row in speeds] == [row["time_s"] for row in van]


def test_a_body_is_there_only_while_its_entity_is(recorded: Path) -> None:
    body = rows(recorded, f"{paths.ENTITIES}/{WALKER}/body")
    shown = [(row["time_s"], row.get("Boxes3D:half_sizes") is not None) for row in body]
    assert shown == [(0.5, True), (0.85, False), (1.2, True), (1.55, False)]
    half = next(row["Boxes3D:half_sizes"] for row in body if row["time_s"] == 0.5)
    assert np.allclose(half, [[0.25, 0.3, 0.75]])
    for key in ("near", "far"):
        label = rows(recorded, f"{paths.NAMES}/{key}/{WALKER}/label")
        assert [row["time_s"] for row in label] == [0.5, 0.85, 1.2, 1.55]
    # Who is there until the end does not vanish with it.
    assert [row["time_s"] for row in rows(recorded, f"{paths.ENTITIES}/{EGO}/body")] == [0.0]


def test_the_view_follows_the_ego(recorded: Path) -> None:
    centre = rows(recorded, paths.CENTRE)
    ego = rows(recorded, f"{paths.ENTITIES}/{EGO}")
    assert [row["Transform3D:translation"] for row in centre] == [
        row["Transform3D:translation"] for row in ego
    ]
    nobody = played(entities=[], elements=[], transitions=[])
    assert paths.followed(nobody) == -1
    others = played(entities=played().entities[1:], elements=[], transitions=[])
    assert paths.followed(others) == 0


def events(path: Path) -> list[tuple[float, str, str]]:
    return [
        (row["time_s"], row["TextLog:level"][0], row["TextLog:text"][0])
        for row in rows(path, paths.EVENTS)
    ]


def test_the_log_tells_events_triggers_and_who_comes_and_goes(recorded: Path) -> None:
    assert events(recorded) == [
        (0.0, "INFO", "the storyboard begins"),
        (0.0, "TRACE", "story s begins"),
        (0.5, "INFO", "walker appears"),
        (0.5, "INFO", "event cut in begins (trigger near and slow)"),
        (0.5, "DEBUG", "van: lane change change begins"),
        (0.85, "INFO", "walker vanishes"),
        (1.2, "INFO", "walker appears"),
        (1.5, "DEBUG", "van: lane change change ends"),
        (1.5, "INFO", "event cut in ends"),
        (1.55, "INFO", "walker vanishes"),
        (2.0, "INFO", "the storyboard is stopped"),
    ]
    event = next(row for row in rows(recorded, paths.EVENTS) if "cut in begins" in str(row))
    facts = {name: event[name][0] for name in ("element", "element_level", "transition", "line")}
    assert facts == {
        "element": "s::a::g::m::cut in",
        "element_level": "event",
        "transition": "start",
        "line": 12,
    }


def test_where_an_event_began_is_marked_from_then_on(recorded: Path) -> None:
    [point] = rows(recorded, f"{paths.FIRED}/000")
    assert point["time_s"] == 0.5
    assert np.allclose(point["Points3D:positions"], [[24.0, 3.5, 0.1]])
    for eye in top_eyes(played(), np.zeros(3)):
        [name] = rows(recorded, f"{paths.NAMES}/{eye.key}/event-000")
        assert (name["time_s"], name["Points3D:labels"]) == (0.5, ["cut in 0.50 s"])
        above = name["Points3D:positions"][0][1] - 3.5
        assert above > 20.0 * eye.pixel_m


def test_events_that_begin_at_once_are_not_marked_and_others_up_to_a_limit() -> None:
    elements = [PlayElement(level="event", name=f"e{i}", path="", actors=[i % 2]) for i in range(3)]
    starts = [(0.0, 0), (0.5, 0), (0.5, 1), (0.5, 2)]
    steps = [PlayTransition(time_s=t, element=e, transition="start") for t, e in starts]
    marked = story.fired(played(elements=elements, transitions=steps), np.zeros(3))
    assert [row.path for row in marked] == [
        path
        for number in range(2)
        for path in (
            f"{paths.FIRED}/{number:03d}",
            f"{paths.NAMES}/near/event-{number:03d}",
            f"{paths.NAMES}/far/event-{number:03d}",
        )
    ]
    labels = [row.columns[3].as_arrow_array().to_pylist()[0][0] for row in marked[1::3]]
    assert labels == ["e0 +1 0.50 s", "e1 0.50 s"]
    many = [
        PlayTransition(time_s=0.01 * (i + 1), element=0, transition="start")
        for i in range(story.FIRED_MAX + 1)
    ]
    all_ = story.fired(played(elements=elements, transitions=many), np.zeros(3))
    assert len(all_) == 3 * story.FIRED_MAX


def test_what_is_cut_short_stands_out(tmp_path: Path) -> None:
    steps = [
        PlayTransition(time_s=1.0, element=3, transition="stop"),
        PlayTransition(time_s=1.0, element=2, transition="skip"),
    ]
    write_recording(played(transitions=steps), tmp_path / "s.rrd")
    told = [row for row in events(tmp_path / "s.rrd") if "walker" not in row[2]]
    assert told == [
        (1.0, "WARN", "van: lane change change is stopped"),
        (1.0, "WARN", "event cut in is skipped"),
    ]


HOSTILE = "a\x1b[2J\nb"


def test_hostile_names_are_escaped_everywhere(tmp_path: Path) -> None:
    bodies = [entity(HOSTILE, straight(1.0)), entity("", straight(1.0)), entity("/x", straight(1))]
    elements = [
        PlayElement(
            level="event", name=HOSTILE, path=HOSTILE, trigger=HOSTILE, action=HOSTILE, actors=[0]
        )
    ]
    steps = [PlayTransition(time_s=0.5, element=0, transition="start")]
    play = played(
        name=HOSTILE, entities=bodies, elements=elements, transitions=steps, notes=[HOSTILE, "# b"]
    )
    write_recording(play, tmp_path / "s.rrd")
    whole = read_recording(tmp_path / "s.rrd")
    entities = {name for name in whole.rows if name.startswith(f"{paths.SPEEDS}/")}
    assert len(entities) == 3
    assert all(name.isprintable() for name in (*whole.rows, *whole.static))
    assert [text for _, _, text in events(tmp_path / "s.rrd")] == [
        r"event a\x1b[2J\nb begins (trigger a\x1b[2J\nb)"
    ]
    text = story.summary(play).text.as_arrow_array().to_pylist()[0]
    assert "\x1b" not in text
    assert r"- \# b" in text.splitlines()


def test_a_scenario_far_from_zero_is_drawn_near_it(tmp_path: Path) -> None:
    far = 4_000_000.0
    assert far > FAR_M
    bodies = [entity("Ego", straight(10.0, far + 7.25, 3.5), ego=True)]
    lanes = [
        msgspec.structs.replace(
            played().lanes[0], left=line((far, 2.0), (far + 90, 2.0)),
            right=line((far, 0.0), (far + 90, 0.0)),
        )
    ]  # fmt: skip
    play = played(entities=bodies, lanes=lanes, marks=[], paths=[], elements=[], transitions=[])
    write_recording(play, tmp_path / "s.rrd")
    place = rows(tmp_path / "s.rrd", f"{paths.ENTITIES}/{EGO}")[0]["Transform3D:translation"][0]
    assert np.allclose(place, [7.25, 3.5, 0.0])
    assert read_recording(tmp_path / "s.rrd").properties["play"]["origin_m"] == far


def test_a_scenario_of_nothing_is_a_recording(tmp_path: Path) -> None:
    nothing = played(
        entities=[entity("nobody", np.empty((0, 6)))], lanes=[], marks=[], paths=[], elements=[],
        transitions=[], notes=[],
    )  # fmt: skip
    write_recording(nothing, tmp_path / "s.rrd")
    assert read_recording(tmp_path / "s.rrd").rows == {}
    bare = played(
        entities=[],
        lanes=[msgspec.structs.replace(played().lanes[0], left=b"", right=b"")],
        marks=[PlayMark(color="", width_m=0, stroke_m=0, gap_m=0, from_m=0, points=b"")],
        paths=[msgspec.structs.replace(played().paths[0], points=b"")],
        elements=[],
        transitions=[],
    )
    write_recording(bare, tmp_path / "t.rrd")
    assert [store.application_id for store in RrdReader(tmp_path / "t.rrd").recordings()] == [
        paths.APP
    ]


def test_progress_ends_with_all_entities(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_recording(played(), tmp_path / "s.rrd", told=lambda *row: told.append(row))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_recording_that_cannot_be_written_is_a_line(tmp_path: Path) -> None:
    with pytest.raises(InfrastructureError, match="cannot be written"):
        write_recording(played(), tmp_path / "none" / "s.rrd")


def mark(**changes: float) -> PlayMark:
    values: dict[str, Any] = {"width_m": 0.12, "stroke_m": 3.0, "gap_m": 6.0, "from_m": 0.0}
    return PlayMark(color="white", points=b"", **{**values, **changes})


def test_strokes_follow_the_line_and_its_corners() -> None:
    points = np.array([(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (10.0, 10.0, 0.0)])
    dashes = [stroke.tolist() for stroke in ground.strokes(points, mark(), 99)]
    assert dashes == [
        [[0, 0, 0], [3, 0, 0]],
        [[9, 0, 0], [10, 0, 0], [10, 2, 0]],
        [[10, 8, 0], [10, 10, 0]],
    ]
    whole = [points.tolist()]
    for solid in (mark(stroke_m=0.0), mark(gap_m=0.0), mark(stroke_m=1e-9, gap_m=1e-9)):
        assert [stroke.tolist() for stroke in ground.strokes(points, solid, 99)] == whole
    assert [stroke.tolist() for stroke in ground.strokes(points, mark(), 2)] == whole
    assert list(ground.strokes(points[:1], mark(), 99)) == []
    late = [stroke.tolist() for stroke in ground.strokes(points, mark(from_m=18.0), 99)]
    assert late == [[[10, 8, 0], [10, 10, 0]]]
    assert list(ground.strokes(points, mark(from_m=50.0), 99)) == []


def test_strokes_before_the_line_are_passed_over() -> None:
    points = np.array([(0.0, 0.0, 0.0), (10.0, 0.0, 0.0)])
    dashes = [[0, 2], [8, 10]]
    for from_m in (-1.0, -10.0, -1.0 - 9.0 * 10**8):
        strokes = ground.strokes(points, mark(from_m=from_m), 5)
        assert [stroke[:, 0].tolist() for stroke in strokes] == dashes


def test_presences() -> None:
    poses = np.zeros((5, 6))
    poses[:, 0] = [0.0, 0.05, 0.2, 0.25, 0.5]
    presence = Presence(played(end_s=0.6), poses)
    assert presence.begins_s.tolist() == [0.0, 0.2, 0.5]
    assert presence.ends_s.tolist() == pytest.approx([0.1, 0.3, 0.55])
    assert presence.whole.tolist() == [True, False, True, False]
    assert Presence(played(end_s=0.56), poses).ends_s.tolist() == pytest.approx([0.1, 0.3])
    thinned = poses[::2]
    assert Presence(played(end_s=0.5), thinned).begins_s.tolist() == [0.0]
    for count in (0, 1):
        few = Presence(played(end_s=0.01), poses[:count])
        assert (len(few.begins_s), len(few.ends_s), len(few.whole)) == (count, 0, 0)


def test_eyes_see_all_and_look_along_the_ego() -> None:
    near, far = top_eyes(played(), np.zeros(3))
    assert near.height_m == 22.0 + 1.5 * 10.0
    assert near.below == (pytest.approx(0.25 * near.height_m), 0.0, 0.0)
    assert far.below[:2] == (pytest.approx(18.0), pytest.approx(0.75))
    assert (near.right_rad, far.right_rad) == (0.0, 0.0)
    assert near.upwards(1.0).tolist() == [0.0, near.pixel_m, 0.0]
    north = straight(10.0)
    north[:, [1, 2]], north[:, 4] = north[:, [2, 1]], np.pi / 2
    body = [entity("a", north)]
    one = played(entities=body, elements=[], transitions=[])
    assert far_eye(one, np.zeros(3)).right_rad == pytest.approx(np.pi / 2)
    # Who heads east and is carried north: what is long lies across the picture.
    north[:, 4] = 0.0
    carried = played(entities=[entity("a", north)], elements=[], transitions=[])
    assert far_eye(carried, np.zeros(3)).right_rad == pytest.approx(np.pi / 2)
    nobody = played(entities=[], elements=[], transitions=[])
    assert [eye.key for eye in top_eyes(nobody, np.zeros(3))] == ["far"]


def test_bodies_of_one_category_differ_and_the_ego_has_its_own_colour() -> None:
    bodies = [entity("a", straight(1.0)), entity("b", straight(1.0))]
    bodies.append(entity("c", straight(1.0), ego=True))
    colors = paths.entity_colors(played(entities=bodies, elements=[], transitions=[]))
    assert len(set(colors)) == 3
    assert colors[2] == paths.EGO_COLOR
    assert paths.EGO_COLOR not in paths.CATEGORY_COLORS.values()


def test_a_trail_joins_every_pose_to_the_one_before(recorded: Path) -> None:
    trail = rows(recorded, f"{paths.TRAILS}/{VAN}")
    strips = np.array([row["LineStrips3D:strips"][0] for row in trail])
    poses = straight(8.0, 20.0, 3.5)[:, 1:3]
    assert np.allclose(strips[:, 0, :2], poses[:-1], atol=1e-5)
    assert np.allclose(strips[:, 1, :2], poses[1:], atol=1e-5)
    assert trail[0]["time_s"] == 0.05


def test_a_body_is_turned_as_its_pose_says(tmp_path: Path) -> None:
    turned = straight(0.0)
    turned[:, 4] = 2.5
    play = played(entities=[entity("a", turned)], elements=[], transitions=[])
    write_recording(play, tmp_path / "s.rrd")
    row = rows(tmp_path / "s.rrd", f"{paths.ENTITIES}/000-a")[0]
    expected = [0.0, 0.0, np.sin(1.25), np.cos(1.25)]
    assert np.allclose(row["Transform3D:quaternion"][0], expected)
