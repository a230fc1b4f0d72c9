"""Messages -> what Rerun logs."""

import msgspec
import numpy as np
import pytest
import rerun as rr
from view_messages import STAGE, controls, detection, end, start, state

from schemas.messages import OBJECT_CLASSES, SEMANTIC_CLASSES
from viewer.recording import naming
from viewer.recording.convert import CaseConverter
from viewer.recording.scenery import ORANGE, RED, outline, rotation, verdict_color
from viewer.recording.summary import ended_text, running_text


def paths(logged):
    return [path for path, _ in logged]


def only(logged, path):
    found = [archetype for p, archetype in logged if p == path]
    assert len(found) == 1, paths(logged)
    return found[0]


def converted(*samples, **changes):
    """What these rows become: values of each component by entity path, row by row."""
    return values(CaseConverter(start(**changes)).states(samples))


def values(found):
    shown = {}
    for rows in found:
        assert len(rows.ticks) == len(rows.sim_time_ns)
        for column in rows.columns:
            name = column.component_descriptor().component.partition(":")[2]
            lists = column.as_arrow_array().to_pylist()
            assert len(lists) == len(rows.ticks), (rows.path, name)
            shown.setdefault(rows.path, {}).setdefault(name, []).extend(lists)
    return shown


def test_the_start_holds_intrinsics_street_and_styles():
    logged = CaseConverter(start()).start()
    pinhole = next(a for _, a in logged if isinstance(a, rr.Pinhole))
    matrix = np.array(pinhole.image_from_camera.as_arrow_array().to_pylist()).reshape(3, 3)
    # 70 degrees over 64 pixels; column-major.
    assert matrix[0, 0] == pytest.approx(32 / np.tan(np.radians(35)), rel=1e-6)
    assert matrix[2, 0] == pytest.approx(32)
    assert {naming.OBSTACLE, naming.PARKED, naming.BUILDINGS, naming.STREET} <= set(paths(logged))


def test_lines_run_beside_a_lane_that_bends():
    corner = msgspec.structs.replace(
        STAGE, lane=[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 10.0, np.pi / 2]]
    )
    lines = only(CaseConverter(start(stage=corner)).start(), naming.STREET)
    strips = np.array(lines.strips.as_arrow_array().to_pylist())
    assert strips.shape == (5, 3, 3)  # both edges, the middle, both kerbs
    assert strips[0, :, :2] == pytest.approx(
        np.array([(0, -1.75), (10, -1.75), (21.75, 10)]), abs=1e-5
    )


def test_a_tick_is_one_row_of_every_plot():
    shown = converted(state(1))
    for path in (naming.SPEED, naming.DTC, naming.TTC, naming.BRAKE, naming.THROTTLE, naming.AEB):
        assert len(shown[path]["scalars"]) == 1
    assert shown[naming.SPEED]["scalars"] == [[9.0]]


def test_rows_together_are_those_of_each():
    detections = [[], [detection(20.0), detection(2.0)], [detection(2.0)]]
    samples = [
        state(0, 0, controls=controls(False, detections[0])),
        state(1, 1, boxes=None, controls=controls(True, detections[1]), ttc_s=None),
        state(2, 2, boxes=[], controls=controls(True, detections[2]), collisions=1),
        state(3, 3, boxes=None, controls=controls(True), movers=[[1.0, 2.0, 0.0, 0.1, 1, 1, 2]]),
        state(4, 4, controls=None, boxes=None, speed_mps=1.0),
    ]
    apart = CaseConverter(start())
    single = values([rows for sample in samples for rows in apart.states([sample])])
    together = CaseConverter(start()).states(samples)
    assert values(together) == single
    at = {rows.path: rows.ticks for rows in together}
    assert at[naming.EGO] == [0, 1, 2, 3, 4]
    assert at[naming.TTC] == [0, 2, 3, 4]
    assert at[naming.TRUTH] == [0, 2]
    assert at[naming.DETECTIONS] == [0, 1, 2]
    assert at[naming.BRAKE] == [0, 1, 2, 3]
    assert at[naming.MOVERS] == [3]
    assert CaseConverter(start()).states([]) == []


def test_boxes_have_the_classes_that_the_world_names():
    found = [detection(20.0), msgspec.structs.replace(detection(20.0), label="yeti")]
    shown = converted(state(0, controls=controls(False, found)))
    car = SEMANTIC_CLASSES.index("car")
    assert shown[naming.DETECTIONS]["class_ids"] == [[car, 0]]
    assert shown[naming.TRUTH]["class_ids"] == [[car]]
    assert "colors" not in shown[naming.TRUTH], "those of the classes"
    [context] = [
        a for _, a in CaseConverter(start()).start() if isinstance(a, rr.AnnotationContext)
    ]
    [classes] = context.context.as_arrow_array().to_pylist()
    named = [entry["class_description"]["info"]["label"] for entry in classes]
    assert named == list(SEMANTIC_CLASSES)
    assert set(OBJECT_CLASSES) <= set(named)


def test_missing_is_not_zero():
    shown = converted(state(1, ttc_s=None, controls=None, boxes=None))
    assert not {naming.TTC, naming.BRAKE, naming.AEB, naming.TRUTH} & set(shown)
    assert naming.SPEED in shown


def test_events_come_once():
    samples = [
        state(tick, tick, controls=controls(bool(aeb), [detection()] if seen else []))
        for tick, (aeb, seen) in enumerate([(0, 0), (0, 1), (1, 1), (1, 1), (0, 1), (1, 1)])
    ]
    texts = [text for [text] in converted(*samples)[naming.EVENTS]["text"]]
    assert [text.split(" (")[0].split(":")[0] for text in texts] == [
        "first detection",
        "AEB triggered",
        "AEB triggered",
    ]
    # Whose distance it is: a detection may be of something else.
    assert texts[0].endswith("(obstacle 19.0 m ahead)")


def test_far_boxes_have_no_labels_and_aeb_is_red():
    shown = converted(state(0, controls=controls(True, [detection(20.0), detection(1.0)])))
    near, far = shown[naming.DETECTIONS], shown[naming.DETECTIONS_FAR]
    assert [len(row) for row in (*near["half_sizes"], *far["half_sizes"])] == [1, 1]
    red = (RED[0] << 24) + (RED[1] << 16) + (RED[2] << 8) + 255
    assert near["colors"] == [[red]]
    styles = {
        path: archetype.show_labels.as_arrow_array().to_pylist()
        for path, archetype in CaseConverter(start()).start()
        if isinstance(archetype, rr.Boxes2D)
    }
    assert styles[naming.DETECTIONS] == [True]
    assert styles[naming.DETECTIONS_FAR] == [False]


def test_the_box_that_triggered_is_marked_until_the_next_frame():
    seen = [detection(4.0), detection(20.0)]
    samples = [
        state(0, 0, controls=controls(False, seen)),
        state(1, 1, controls=controls(True, seen, trigger=1)),
        state(2, 2, controls=controls(True), boxes=None),
        state(3, 3, controls=controls(True, seen)),
        state(4, 4, controls=controls(True, seen)),
    ]
    shown = converted(*samples)
    assert [len(row) for row in shown[naming.TRIGGER]["half_sizes"]] == [1, 0]
    assert shown[naming.TRIGGER]["half_sizes"][0] == [[10.0, 4.0]]
    said = [text for [text] in shown[naming.EVENTS]["text"] if text.startswith("AEB")]
    assert said == ["AEB triggered (obstacle 19.0 m ahead), 9.0 m/s, by car 0.90"]
    # Messages come one by one to a live viewer.
    converter = CaseConverter(start())
    alone = [values(converter.states([s])).get(naming.TRIGGER) for s in samples]
    assert [row and [len(r) for r in row["half_sizes"]] for row in alone] == [
        None,
        [1],
        None,
        [0],
        None,
    ]


@pytest.mark.parametrize("trigger", [None, -1, 1])
def test_a_stack_that_does_not_say_what_triggered_gets_no_mark(trigger):
    shown = converted(state(0, controls=controls(True, [detection()], trigger)))
    assert naming.TRIGGER not in shown
    assert shown[naming.EVENTS]["text"][-1] == ["AEB triggered (obstacle 20.0 m ahead), 9.0 m/s"]


def test_no_detections_clear_the_boxes():
    shown = converted(state(0, controls=controls(), boxes=[]))
    assert shown[naming.DETECTIONS]["half_sizes"] == [[]]
    assert shown[naming.TRUTH]["half_sizes"] == [[]]


def test_verdict_and_its_words():
    converter = CaseConverter(start())
    converter.states([state(1, 42)])
    [said] = converter.end(end(9, verdict="false_braking"))
    assert "false_braking: came to rest" in values([said])[naming.EVENTS]["text"][0][0]
    assert said.ticks == [42], "an end has the tick of the last row"
    assert verdict_color("false_braking") == ORANGE
    assert "heavy fog, 05:00" in running_text(start())
    text = ended_text(start(), end(9), lost=4)
    assert "**PASS** came to rest 3.00 m" in text
    assert "4 samples are missing" in text
    assert "closest 3.00 m · AEB after - · " in text
    assert "lateral" not in text
    kept = {"distance_m": 100.2, "lateral_error_rms_m": 0.05, "lateral_error_max_m": None}
    lane = ended_text(start(), end(9, scalars=kept), lost=0)
    assert "lateral error RMS 0.05 m · largest lateral error - · " in lane
    assert "NO VERDICT" in ended_text(start(), None, lost=0)
    given_up = CaseConverter(start()).end(end(9, outcome="", verdict=""))
    assert "given up" in values(given_up)[naming.EVENTS]["text"][0][0]


def test_a_lane_is_drawn_at_its_height_and_level_where_heights_do_not_fit():
    def heights(stage):
        strips = next(what for where, what in outline(stage) if where == naming.STREET).strips
        return [point[2] for point in strips.as_arrow_array().to_pylist()[0]]

    lane = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.1], [20.0, 2.0, 0.2]]
    stage = msgspec.structs.replace(STAGE, lane=lane, lane_z_m=[1.0, 2.0, 4.0])
    assert heights(stage) == pytest.approx([1.02, 2.02, 4.02])
    assert heights(msgspec.structs.replace(stage, lane_z_m=[])) == pytest.approx([0.02] * 3)
    assert heights(msgspec.structs.replace(stage, lane_z_m=[5.0])) == pytest.approx([0.02] * 3)


def test_ego_and_movers_stand_on_the_slope():
    hull = [1.0, 2.0, 5.0, 0.3, 2.0, 1.0, 1.5]
    samples = [
        state(0, 0, z_m=4.0, pitch_rad=0.1, roll_rad=-0.2, movers=[hull, hull],
              mover_tilts=[[0.1, -0.2], [0.0, 0.0]]),
        state(1, 1, controls=None, movers=[hull]),  # the last row says nothing of heights
    ]  # fmt: skip
    shown = converted(*samples)
    ego = shown[naming.EGO]
    assert [place[2] for [place] in ego["translation"]] == [4.0, 4.0]
    assert [place[2] for [place] in shown[naming.TRAIL]["positions"]] == pytest.approx([4.08] * 2)
    turns = [rr_matrix(turn) for [turn] in ego["quaternion"]]
    assert turns[0] == pytest.approx(rotation(np.degrees([-0.2, 0.1, 0.0])), abs=1e-6)
    assert (turns[1] == turns[0]).all()
    moved = shown[naming.MOVERS]
    for (centres, halves, turns), tilts in zip(
        zip(moved["centers"], moved["half_sizes"], moved["quaternions"], strict=True),
        [[(0.1, -0.2), (0.0, 0.0)], [(0.0, 0.0)]],
        strict=True,
    ):
        for centre, half, turn, (pitch, roll) in zip(centres, halves, turns, tilts, strict=True):
            expected = rotation(np.degrees([roll, pitch, 0.3]))
            assert rr_matrix(turn) == pytest.approx(expected, abs=1e-6)
            assert centre == pytest.approx(hull[:3] + 0.75 * expected[:, 2], abs=1e-6)
            assert half == pytest.approx([2.0, 1.0, 0.75])


def rr_matrix(turn):
    """[3, 3] of a quaternion x, y, z, w."""
    x, y, z, w = turn
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
