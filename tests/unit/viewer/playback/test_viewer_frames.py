"""Reading a recording back: what was logged, tick by tick."""

import pytest
import rerun as rr
from unit.viewer.recorded_case import PICTURES, write
from view_messages import end, start, state

from twin.base.errors import UsageError
from viewer.playback.folder import find_moment, find_recording
from viewer.playback.frames import Mark, read_case
from viewer.recording import naming
from viewer.recording.recording import RecordingFile


def test_every_tick_comes_back_in_order_with_what_was_seen(tmp_path):
    case = read_case(write(tmp_path))
    assert [frame.sim_time_ns for frame in case.frames] == [50_000_000 * i for i in range(6)]
    assert [frame.jpeg for frame in case.pictures] == PICTURES
    first, *_, braking, last = case.frames
    assert (first.speed_mps, first.dtc_m, first.ttc_s, first.x_m) == (9.0, 20.0, 2.0, 200.0)
    assert first.yaw_rad == 0.0
    assert first.truth == [Mark(10.0, 12.0, 20.0, 8.0, "car 21 m")]
    assert first.detections == [
        Mark(10.0, 10.0, 20.0, 8.0, "car 0.90"),
        Mark(10.0, 10.0, 2.0, 8.0, "car 0.90"),
    ]
    assert (first.aeb, braking.aeb) == (False, True)
    assert (braking.brake, braking.throttle) == (1.0, 0.0)
    # Missing is None, never 0.
    assert (last.aeb, last.brake, last.detections, last.jpeg, last.ttc_s) == (None,) * 5
    assert case.frames[1].truth is None
    assert [event.text.split(" ")[0] for event in case.events] == ["first", "AEB", "pass:"]
    assert case.properties["case"]["model"] == "yolov3"
    assert case.properties["verdict"]["passed"] is True


def test_readings_of_sensors_come_back_when_they_were_due(tmp_path):
    recording = RecordingFile(start(tmp_path, sensors={"thermometer": ["air_c", "ground_c"]}))
    for tick, told in enumerate([{"thermometer": [20.0, 18.5]}, {}, {"thermometer": [19.0]}]):
        recording.state(state(tick + 1, tick, sensors=told))
    recording.close(end(4, tick=2))
    frames = read_case(tmp_path / naming.RECORDING_FILE).frames
    assert [frame.readings for frame in frames] == [
        {"thermometer": {"air_c": 20.0, "ground_c": 18.5}},
        {},
        {},  # a row of another length than was announced is none
    ]


def test_the_box_that_triggered_comes_back_in_its_tick_alone(tmp_path):
    frames = read_case(write(tmp_path, told=2)).frames
    near = Mark(10.0, 10.0, 20.0, 8.0, "car 0.90")
    assert [frame.trigger for frame in frames] == [None, None, near, None, None, None]
    assert near in frames[2].detections, "it is still one of the detections"
    assert all(frame.trigger is None for frame in read_case(write(tmp_path)).frames)


@pytest.mark.parametrize(("time_ms", "index"), [(0, 0), (99, 0), (100, 1), (1e6, 2)])
def test_the_picture_of_a_time_is_the_latest_until_then(tmp_path, time_ms, index):
    case = read_case(write(tmp_path))
    assert case.picture_at(int(time_ms * 1e6)).jpeg == PICTURES[index]


def test_a_killed_recorder_leaves_what_it_wrote(tmp_path):
    whole = write(tmp_path, ended=False).read_bytes()
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(whole[: len(whole) * 3 // 10])
    case = read_case(cut)
    assert case.properties["case"]["case"] == "clear-1"
    assert "verdict" not in case.properties
    assert case.path == cut


def test_moments_of_an_attempt_that_left_no_kpi_rows(tmp_path):
    for name, brakes in (("braked", True), ("not", False)):
        write(tmp_path / "cases" / name / "attempt-1", ended=False, brakes=brakes)
    braked = find_recording(tmp_path, "braked")
    assert not braked.complete
    assert find_moment(braked, "aeb").sim_time_ns == 150_000_000
    assert find_moment(braked, "closest").sim_time_ns == 200_000_000
    assert "no AEB trigger" in find_moment(find_recording(tmp_path, "not"), "aeb").label


def test_what_is_no_recording_of_a_case_is_refused_in_one_line(tmp_path):
    other = tmp_path / "other.rrd"
    stream = rr.RecordingStream("another_app", recording_id="x")
    stream.save(other)
    stream.log("a", rr.Scalars(1.0))
    stream.flush()
    stream.disconnect()
    nonsense = tmp_path / "nonsense.rrd"
    nonsense.write_bytes(b"nonsense, and quite a lot of it, more than a header would be long")
    empty = tmp_path / "empty.rrd"
    empty.touch()
    for path in (other, nonsense, empty, tmp_path / "none.rrd"):
        with pytest.raises(UsageError) as error:
            read_case(path)
        assert str(path) in str(error.value)
        assert len(str(error.value).splitlines()) == 1


def test_a_recording_without_pictures_says_so(tmp_path):
    recording = RecordingFile(start(tmp_path))
    recording.state(state(1, 0, boxes=None))
    recording.close(end(2, tick=1))
    case = read_case(tmp_path / naming.RECORDING_FILE)
    assert case.pictures == []
    with pytest.raises(UsageError, match="no camera picture"):
        case.picture_at(0)
