"""A recording: written, read back with Rerun's own reader, honest about what is missing."""

import contextlib
import hashlib
import json
import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from recordings import read_recording
from view_messages import STAGE, camera, end, start, state

from schemas import SCHEMA_VERSION
from schemas.wire.codec import encode
from schemas.wire.view import CaseEnd, CaseStart, RecorderBatch, RecorderSample, StateSample
from twin.view.samples import jpeg
from viewer.recording import naming
from viewer.recording.blueprint import case_blueprint
from viewer.recording.command import CLOSED_MAX, OpenRecordings
from viewer.recording.recording import FLUSH_BYTES, FLUSH_PERIOD_S, RecordingFile

PICTURE = jpeg(np.zeros((36, 64, 3), np.uint8))


def write(folder, skip=()):
    """Three ticks and an end, without the running numbers in ``skip``."""
    recording = RecordingFile(start(folder))
    seq = 1
    for tick in range(3):
        if seq not in skip:
            recording.camera(camera(seq, tick), PICTURE)
        if seq + 1 not in skip:
            recording.state(state(seq + 1, tick))
        seq += 2
    return recording, seq


def test_a_complete_recording(tmp_path):
    recording, seq = write(tmp_path)
    assert recording.close(end(seq))
    note = json.loads((tmp_path / naming.RECORDING_NOTE).read_text())
    data = (tmp_path / naming.RECORDING_FILE).read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    whole = {"complete": True, "samples": 8, "lost": 0}
    assert note == {**whole, "kept": True, "sha256": sha256, "bytes": len(data)}
    found = read_recording(tmp_path / naming.RECORDING_FILE)
    assert found.rows[naming.SPEED] == found.rows[naming.CAMERA] == 3
    assert found.properties["verdict"]["verdict"] == "pass"
    assert found.properties["verdict"]["complete"] is True
    assert found.properties["case"]["time_of_day"] == "05:00"
    assert found.recording_id == "demo-clear-1-1"
    assert found.blueprints == 1
    assert not list(tmp_path.glob("*.tmp"))


def test_the_street_shows_who_walks_and_drives_and_forgets_who_has_gone(tmp_path):
    walker, van = [140.0, -3.9, 0.0, 1.6, 0.25, 0.25, 1.7], [170.0, 3.5, 0.0, 3.1, 2.4, 0.9, 2.0]
    recording = RecordingFile(start(tmp_path))
    moving = [[walker, van], [walker], [], []]
    for seq, hulls in enumerate(moving, start=1):
        recording.state(state(seq, seq - 1, movers=hulls))
    # The last row: nobody has looked at what moves.
    recording.state(state(5, 4, controls=None, boxes=None))
    assert recording.close(end(6))
    found = read_recording(tmp_path / naming.RECORDING_FILE)
    assert found.rows[naming.MOVERS] == 3  # two, one, none; then nothing changes
    assert naming.MOVERS in found.static


@pytest.mark.parametrize(("skip", "lost"), [((1,), 1), ((3, 4), 2), ((6,), 1)])
def test_gaps_are_told(tmp_path, skip, lost):
    recording, seq = write(tmp_path, skip)
    assert not recording.close(end(seq))
    note = json.loads((tmp_path / naming.RECORDING_NOTE).read_text())
    assert (note["complete"], note["samples"], note["lost"]) == (False, 8 - lost, lost)
    found = read_recording(tmp_path / naming.RECORDING_FILE)
    assert found.properties["verdict"]["complete"] is False
    assert found.properties["verdict"]["verdict"] == "pass"


def test_an_end_that_never_came(tmp_path):
    recording, _ = write(tmp_path)
    assert not recording.close(None)
    assert json.loads((tmp_path / naming.RECORDING_NOTE).read_text())["complete"] is False


def message(*samples):
    """What a rig's feed sends, of starts, states, ends, and pictures as pairs."""
    kinds = {CaseStart: "start", StateSample: "state", CaseEnd: "end"}
    parts = [
        RecorderSample(camera=one[0], jpeg=one[1])
        if isinstance(one, tuple)
        else RecorderSample(**{kinds[type(one)]: one})
        for one in samples
    ]
    return encode(RecorderBatch(SCHEMA_VERSION, parts))


def test_the_recorder_keeps_attempts_apart_and_survives_nonsense(tmp_path, capsys):
    recorder = OpenRecordings()
    other = start(tmp_path / "b", token=2, case="other")
    recorder.take(message(start(tmp_path / "a", token=1), other))
    recorder.take(b"\xc1nonsense")
    recorder.take(message(state(5, token=99)))  # nobody's
    recorder.take(message((camera(1, token=1), PICTURE), state(2, token=1), state(1, token=2)))
    recorder.take(message(end(3, token=1)))
    recorder.close()
    assert (recorder.complete, recorder.incomplete) == (1, 1)
    assert read_recording(tmp_path / "a" / naming.RECORDING_FILE).rows[naming.SPEED] == 1
    assert not json.loads((tmp_path / "b" / naming.RECORDING_NOTE).read_text())["complete"]
    assert "not MessagePack" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_costs_that_recording_only(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    recorder = OpenRecordings()
    folder = tmp_path / "file" / "a"
    recorder.take(message(start(folder, token=1), state(1, token=1), end(2, token=1)))
    assert (recorder.complete, recorder.incomplete) == (0, 1)
    assert "not recorded" in capsys.readouterr().err


def test_what_has_waited_is_written_though_nothing_else_comes(tmp_path):
    recording = RecordingFile(start(tmp_path))
    recording.camera(camera(1, 0), PICTURE, 100.0)
    recording.state(state(2, 0), 101.0)
    path = tmp_path / naming.RECORDING_FILE
    recording.write(100.0 + FLUSH_PERIOD_S - 0.1)
    recording._stream.flush()
    assert naming.SPEED not in read_recording(path).rows
    recording.write(100.0 + FLUSH_PERIOD_S)
    recording._stream.flush()
    found = read_recording(path)  # as a recorder that is killed now leaves it
    assert found.rows[naming.SPEED] == found.rows[naming.CAMERA] == 1
    assert found.properties["case"]["case"] == "clear-1"
    recording.close(None)


def test_large_pictures_do_not_wait(tmp_path):
    recording = RecordingFile(start(tmp_path))
    for tick in range(3):
        recording.camera(camera(1 + tick, tick), b"x" * (FLUSH_BYTES // 2), 0.0)
    recording._stream.flush()
    assert read_recording(tmp_path / naming.RECORDING_FILE).rows[naming.CAMERA] == 2
    recording.close(None)


@pytest.mark.parametrize(
    ("keep", "ending", "kept"),
    [
        ("failed", {}, False),
        ("all", {}, True),
        ("failed", {"verdict": "collision", "passed": False}, True),
        ("failed", {"verdict": "false_braking", "passed": True}, True),
        ("failed", {"outcome": "failed", "verdict": "pass", "passed": False}, True),
        ("failed", {"outcome": "", "verdict": "", "passed": False}, True),
        ("failed", None, True),
    ],
)
def test_what_is_not_a_pass_is_kept(tmp_path, keep, ending, kept):
    recording = RecordingFile(msgspec.structs.replace(start(tmp_path), keep=keep))
    recording.state(state(1))
    recording.close(None if ending is None else end(2, **ending))
    note = json.loads((tmp_path / naming.RECORDING_NOTE).read_text())
    assert note["kept"] is kept
    assert ("sha256" in note) is kept
    assert note["complete"] is (ending is not None)
    assert (tmp_path / naming.RECORDING_FILE).exists() is kept


def test_layouts_share_their_names():
    """Rerun keeps every entity's name that it has ever met."""
    layouts = [case_blueprint(STAGE), case_blueprint(msgspec.structs.replace(STAGE, cars=2))]
    first, second = ([part.id for part in parts(layout.root_container)] for layout in layouts)
    assert first == second
    assert len(first) == len(set(first)) > 8


def test_a_recording_leaves_no_time_in_the_recorders_thread(tmp_path):
    """Rerun keeps a stream's time as long as the thread that set it."""
    threads = set()
    told = rr.RecordingStream.set_time

    def set_time(*arguments, **named):
        threads.add(threading.get_ident())
        told(*arguments, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rr.RecordingStream, "set_time", set_time)
        recording, seq = write(tmp_path)
        recording.close(end(seq))
    assert threads
    assert threading.get_ident() not in threads


def parts(part):
    yield part
    for below in part.contents if isinstance(part, rrb.Container) else []:
        yield from parts(below)


def test_a_recorder_of_many_cases_keeps_no_threads(tmp_path):
    """Rerun keeps two threads per stream until it is asked to let go."""
    recorder = OpenRecordings()
    threads = []
    for token in range(1, 16):
        said = start(tmp_path / str(token), token=token)
        recorder.take(message(said, end(1, token=token)))
        threads.append(threads_of_streams())
    assert recorder.complete == 15
    assert max(threads) > 0
    assert max(threads[8:]) <= max(threads[:8])
    assert len(threads) % CLOSED_MAX, "some wait to be let go of"
    recorder.write(0.0)
    assert threads_of_streams() < threads[-1], "and are, within a turn"


def threads_of_streams():
    """Threads that Rerun has started for streams; libraries start others at any time."""
    found = []
    for path in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):  # it has ended
            found.append((path / "comm").read_text().strip())
    return sum(name.startswith(("RecordingStream", "ChunkBatcher")) for name in found)
