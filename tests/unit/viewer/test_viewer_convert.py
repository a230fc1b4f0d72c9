"""Messages -> what Rerun logs."""

import msgspec
import numpy as np
import pytest
import rerun as rr
from view_messages import STAGE, controls, detection, end, start, state

from viewer import naming
from viewer.convert import CaseConverter
from viewer.scenery import ORANGE, RED, verdict_color
from viewer.summary import ended_text, running_text


def paths(logged):
    return [path for path, _ in logged]


def only(logged, path):
    found = [archetype for p, archetype in logged if p == path]
    assert len(found) == 1, paths(logged)
    return found[0]


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
    logged = CaseConverter(start()).state(state(1))
    for path in (naming.SPEED, naming.DTC, naming.TTC, naming.BRAKE, naming.THROTTLE, naming.AEB):
        assert isinstance(only(logged, path), rr.Scalars)
    assert only(logged, naming.SPEED).scalars.as_arrow_array().to_pylist() == [9.0]


def test_missing_is_not_zero():
    logged = CaseConverter(start()).state(state(1, ttc_s=None, controls=None, boxes=None))
    assert not {naming.TTC, naming.BRAKE, naming.AEB, naming.TRUTH} & set(paths(logged))
    assert naming.SPEED in paths(logged)


def test_events_come_once():
    converter = CaseConverter(start())
    events = []
    for tick, (aeb, seen) in enumerate([(0, 0), (0, 1), (1, 1), (1, 1), (0, 1), (1, 1)]):
        asked = controls(bool(aeb), [detection()] if seen else [])
        logged = converter.state(state(tick, tick, controls=asked))
        events += [a for p, a in logged if p == naming.EVENTS]
    texts = [e.text.as_arrow_array().to_pylist()[0] for e in events]
    assert [text.split(" at ")[0].split(":")[0] for text in texts] == [
        "first detection",
        "AEB triggered",
        "AEB triggered",
    ]


def test_far_boxes_have_no_labels_and_aeb_is_red():
    asked = controls(True, [detection(20.0), detection(1.0)])
    logged = CaseConverter(start()).state(state(0, controls=asked))
    near, far = only(logged, naming.DETECTIONS), only(logged, naming.DETECTIONS_FAR)
    assert len(near.half_sizes) == len(far.half_sizes) == 1
    assert near.show_labels.as_arrow_array().to_pylist() == [True]
    assert far.show_labels.as_arrow_array().to_pylist() == [False]
    red = (RED[0] << 24) + (RED[1] << 16) + (RED[2] << 8) + 255
    assert near.colors.as_arrow_array().to_pylist() == [red]


def test_no_detections_clear_the_boxes():
    logged = CaseConverter(start()).state(state(0, controls=controls(), boxes=[]))
    assert len(only(logged, naming.DETECTIONS).half_sizes) == 0
    assert len(only(logged, naming.TRUTH).half_sizes) == 0


def test_verdict_and_its_words():
    event = CaseConverter(start()).end(end(9, verdict="false_braking", passed=True))[0][1]
    assert "false_braking: came to rest" in event.text.as_arrow_array().to_pylist()[0]
    assert verdict_color("false_braking") == ORANGE
    assert "heavy fog, 05:00" in running_text(start())
    text = ended_text(start(), end(9), lost=4)
    assert "**PASS** came to rest 3.00 m" in text
    assert "4 samples are missing" in text
    assert "| AEB after [s] | - |" in text
    assert "lateral" not in text
    kept = {"distance_m": 100.2, "lateral_error_rms_m": 0.05, "lateral_error_max_m": None}
    lane = ended_text(start(), end(9, scalars=kept), lost=0)
    assert "| lateral error RMS [m] | 0.05 |" in lane
    assert "| largest lateral error [m] | - |" in lane
    assert "NO VERDICT" in ended_text(start(), None, lost=0)
    given_up = CaseConverter(start()).end(end(9, outcome="", verdict="", passed=False))[0][1]
    assert "given up" in given_up.text.as_arrow_array().to_pylist()[0]
