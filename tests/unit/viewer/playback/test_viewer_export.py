"""Films and MCAP files, read back by other tools: ffprobe, PyAV's decoder, the mcap library."""

import builtins
import json
import shutil
import subprocess
from fractions import Fraction

import av
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image
from unit.viewer.recorded_case import PICTURES, write
from view_messages import camera, end, start, state

from schemas.kinds.sensor import sensor_kinds
from schemas.wire.view import RowsSite
from twin.base.errors import UsageError
from viewer.playback.frames import read_case
from viewer.playback.mcap_file import write_mcap
from viewer.playback.outputs import needed
from viewer.playback.video import CLIP_WIDTH_PX, answer_films, write_clip, write_film
from viewer.recording import naming
from viewer.recording.recording import RecordingFile
from viewer.recording.scenery import rotation


def with_a_gap(folder):
    """Pictures at 0, 50, 200 ms; the two between them were lost."""
    recording = RecordingFile(start(folder))
    for seq, (tick, picture) in enumerate(zip((0, 1, 4), PICTURES, strict=True), 1):
        recording.camera(camera(seq, tick), picture)
    recording.state(state(4, 4, boxes=None))
    recording.close(end(5, tick=4))
    return folder / naming.RECORDING_FILE


def shades(path):
    """Mean grey of every frame's upper half, as decoded, and the times [s]."""
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    return [f.to_ndarray(format="gray")[:180].mean() for f in frames], [f.time for f in frames]


def test_a_film_has_a_frame_per_camera_period_of_sim_time(tmp_path):
    out = tmp_path / "a.mp4"
    film = write_film(read_case(write(tmp_path)), out)
    assert (film.frames, film.rate_hz, film.held) == (3, Fraction(10), 0)
    grey, times = shades(out)
    assert grey == pytest.approx([10, 120, 230], abs=4)
    assert times == pytest.approx([0.0, 0.1, 0.2])


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="no ffprobe; apt-get install ffmpeg")
def test_a_film_as_ffprobe_sees_it(tmp_path):
    out = tmp_path / "a.mp4"
    write_film(read_case(write(tmp_path)), out)
    asked = "stream=codec_name,pix_fmt,width,height,nb_read_frames,avg_frame_rate,duration"
    done = subprocess.run(
        ["ffprobe", "-v", "error", "-count_frames", "-show_entries", asked, "-of", "json", out],
        capture_output=True,
        check=True,
    )
    (found,) = json.loads(done.stdout)["streams"]
    assert (found["codec_name"], found["pix_fmt"]) == ("h264", "yuv420p")
    assert (found["width"], found["height"]) == (640, 388)
    assert found["nb_read_frames"] == "3"
    assert found["avg_frame_rate"] == "10/1"
    assert float(found["duration"]) == pytest.approx(0.3)


def test_a_gap_in_the_recording_keeps_its_length_in_the_film(tmp_path):
    out = tmp_path / "a.mp4"
    film = write_film(read_case(with_a_gap(tmp_path)), out)
    assert (film.frames, film.rate_hz, film.held) == (5, Fraction(20), 2)
    assert shades(out)[0] == pytest.approx([10, 120, 120, 120, 230], abs=4)


def test_the_end_of_a_film_is_short_small_and_animated(tmp_path):
    out = tmp_path / "a.webp"
    write_clip(read_case(write(tmp_path)), out)
    with Image.open(out) as clip:
        assert (clip.format, clip.n_frames, clip.width) == ("WEBP", 3, CLIP_WIDTH_PX)
        grey = []
        for index in range(clip.n_frames):
            clip.seek(index)
            grey.append(np.asarray(clip.convert("L"))[:100].mean())
            assert clip.info["duration"] == 100
    assert grey == pytest.approx([10, 120, 230], abs=6)


def test_many_films_are_answered_one_by_one(tmp_path):
    write(tmp_path / "cases" / "a" / "attempt-1", campaign="yard", case="a")
    outs = {"a": tmp_path / "a.webp", "none": tmp_path / "none.webp"}
    asked = [json.dumps({"case": case, "out": str(out)}) for case, out in outs.items()]
    made, missing = map(json.loads, answer_films(tmp_path, asked))
    assert made == {"case": "a", "error": ""}
    assert outs["a"].read_bytes()[8:12] == b"WEBP"
    assert missing["case"] == "none"
    assert "none" in missing["error"]
    assert not outs["none"].exists()


def test_the_same_recording_gives_the_same_bytes(tmp_path):
    case = read_case(write(tmp_path))
    makers = {"film.mp4": write_film, "end.webp": write_clip, "log.mcap": write_mcap}
    for name, writer in makers.items():
        first, second = tmp_path / name, tmp_path / f"again-{name}"
        writer(case, first)
        writer(case, second)
        assert first.read_bytes() == second.read_bytes()


def test_an_mcap_file_read_back(tmp_path):
    case = read_case(write(tmp_path, told=2))
    out = tmp_path / "a.mcap"
    written = write_mcap(case, out)
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = {}
        for schema, channel, raw, message in reader.iter_decoded_messages():
            assert raw.log_time == raw.publish_time
            assert message.timestamp.ToNanoseconds() == raw.log_time
            found.setdefault((channel.topic, schema.name), []).append(message)
        metadata = {item.name: item.metadata for item in reader.iter_metadata()}
    assert sum(map(len, found.values())) == written.messages
    assert {key: len(messages) for key, messages in found.items()} == {
        ("/camera/image", "foxglove.CompressedImage"): 3,
        ("/camera/detections", "foxglove.ImageAnnotations"): 5,
        ("/camera/truth", "foxglove.ImageAnnotations"): 3,
        ("/events", "foxglove.Log"): 3,
        ("/state", "drivetwin.State"): 6,
        ("/tf", "foxglove.FrameTransform"): 6,
    }
    assert [m.data for m in found["/camera/image", "foxglove.CompressedImage"]] == PICTURES
    boxes = found["/camera/detections", "foxglove.ImageAnnotations"][0]
    assert [text.text for text in boxes.texts] == ["car 0.90", "car 0.90"]
    assert [(p.x, p.y) for p in boxes.points[0].points] == [(10, 10), (30, 10), (30, 18), (10, 18)]
    assert [
        len(box.points) for box in found["/camera/detections", "foxglove.ImageAnnotations"]
    ] == [*(2, 2, 3, 2, 2)], "the box that triggered is drawn twice"
    first, *_, last = found["/state", "drivetwin.State"]
    assert (first.speed_mps, first.ttc_s, first.HasField("aeb"), first.aeb) == (9, 2, True, False)
    # Missing is absent, never 0.
    assert not any(last.HasField(name) for name in ("aeb", "brake", "throttle", "ttc_s"))
    assert metadata["case"]["model"] == "yolov3"
    assert metadata["verdict"]["passed"] == "true"


def test_without_pictures_there_is_no_film(tmp_path):
    recording = RecordingFile(start(tmp_path))
    recording.state(state(1, 0, boxes=None, controls=None))
    recording.close(end(2, tick=0))
    case = read_case(tmp_path / naming.RECORDING_FILE)
    with pytest.raises(UsageError, match="no camera picture"):
        write_film(case, tmp_path / "a.mp4")
    assert write_mcap(case, tmp_path / "a.mcap").messages == 3
    with pytest.raises(UsageError, match="No such file or directory"):
        write_mcap(case, tmp_path / "no" / "a.mcap")


def test_the_pose_in_an_mcap_file_has_height_pitch_and_roll(tmp_path):
    recording = RecordingFile(start(tmp_path))
    recording.state(state(1, 0, yaw_rad=-0.4))
    recording.state(state(2, 1, yaw_rad=2.0, z_m=4.25, pitch_rad=0.1, roll_rad=-0.2))
    recording.close(end(3, tick=1))
    case = read_case(tmp_path / naming.RECORDING_FILE)
    level, tilted = case.frames
    assert (level.z_m, level.pitch_rad, level.roll_rad) == (0.0, 0.0, 0.0)
    assert (tilted.pitch_rad, tilted.roll_rad) == pytest.approx((0.1, -0.2), abs=1e-6)
    write_mcap(case, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        poses = [message for *_, message in reader.iter_decoded_messages(topics=["/tf"])]
    assert [pose.translation.z for pose in poses] == [0.0, 4.25]
    for pose, degrees in zip(poses, ([0.0, 0.0, -0.4], [-0.2, 0.1, 2.0]), strict=True):
        turn = pose.rotation
        expected = rotation(np.degrees(degrees))
        x, y, z, w = turn.x, turn.y, turn.z, turn.w
        forward = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
        upward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        np.testing.assert_allclose(forward, expected[:, 0], atol=1e-6)
        np.testing.assert_allclose(upward, expected[:, 2], atol=1e-6)


RADAR = sensor_kinds().find("radar")
MOUNTS = ([0.0, 0.0, 45.0], [10.0, -20.0, 170.0], [180.0, 0.0, 0.0], [0.0, 180.0, 0.0])


@pytest.mark.parametrize("rotation_deg", MOUNTS)
def test_detections_in_an_mcap_file_are_points_with_all_their_numbers(tmp_path, rotation_deg):
    site = RowsSite(list(RADAR.columns), RADAR.points, [3.7, 0.9, 0.5], rotation_deg)
    recording = RecordingFile(start(tmp_path, rows={"radar": site}))
    seen = [[10.0, 0.1, 0.0, -3.0, 10.0, 30.0], [20.0, -0.2, 0.05, 1.0, 5.0, 12.0]]
    recording.state(state(1, 0, rows={"radar": seen}))
    recording.state(state(2, 1))
    recording.state(state(3, 2, rows={"radar": []}))
    recording.close(end(4, tick=2))
    write_mcap(read_case(tmp_path / naming.RECORDING_FILE), tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=["/sensors/radar"]))
    assert [schema.name for schema, *_ in found] == ["foxglove.PointCloud"] * 2, "none was due at 1"
    full, empty = (message for *_, message in found)
    names = [field.name for field in full.fields]
    assert names == ["x", "y", "z", *sorted(RADAR.columns)]
    assert [field.offset for field in full.fields] == list(range(0, 36, 4))
    values = np.frombuffer(full.data, "<f4").reshape(-1, full.point_stride // 4)
    for row, sent in zip(values, seen, strict=True):
        named = dict(zip(names, row, strict=True))
        assert [named[column] for column in RADAR.columns] == pytest.approx(sent)
        assert np.linalg.norm(row[:3]) == pytest.approx(sent[0])
        assert np.arctan2(row[1], row[0]) == pytest.approx(sent[1], abs=1e-6)
    assert (len(empty.data), empty.frame_id) == (0, "ego")
    at, turn = full.pose.position, full.pose.orientation
    assert (at.x, at.y, at.z) == pytest.approx((3.7, 0.9, 0.5))
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    matrix = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(matrix, rotation(rotation_deg), atol=1e-6)


def test_a_library_that_is_not_installed_is_named(monkeypatch):
    real = builtins.__import__

    def blocked(name, *rest, **more):
        if name.startswith("av"):
            raise ImportError(name)
        return real(name, *rest, **more)

    assert needed("av", "--mp4") is av
    monkeypatch.setattr("importlib.import_module", blocked)
    with pytest.raises(UsageError, match=r"--mp4 needs the package av; .*drivetwin\[export\]"):
        needed("av", "--mp4")
