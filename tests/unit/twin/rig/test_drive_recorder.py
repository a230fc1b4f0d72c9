"""The record of a drive: exact, readable wherever it was cut off, and of no weight to the case."""

import errno
import sys
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from schemas import SCHEMA_VERSION
from schemas.files.drive_record import DRIVE_FILE, FILE_BYTES_MAX
from schemas.identity import case_digest, rig_key
from schemas.messages import Command, Episode, Tick
from schemas.plan import expand, parse_campaign
from schemas.sections.perception import GroundTruthPerception
from schemas.wire.control import Lease, Result
from twin.base.errors import UsageError
from twin.records.drive_record import RecordReader, RecordWriter, coded, decoded
from twin.rig.drive_recorder import DriveRecorder
from twin.rig.slot import RigTick, Slot, SlotEnd
from twin.sensors.data import SensorData


def case_of(drive):
    data = {"campaign": "c", "matrix": {"weather": ["clear"]}, "recording": {"drive": drive}}
    campaign, mistakes = parse_campaign(data)
    assert not mistakes
    return expand(campaign)[0]


def sensed(tick):
    """Two slots; values say which slot and tick they are of."""
    random = np.random.default_rng(tick)
    return {
        "camera": SensorData(random.integers(0, 256, (2, 9, 16, 3), np.uint8)),
        "boxes": SensorData(random.normal(size=(2, 4, 7)).astype("f4"), np.array([3, 1], np.int32)),
        "vehicle": SensorData(np.array([[tick, np.nan], [tick, -0.0]])),
        "lidar.roof": SensorData(np.full((2, 99, 7), tick, np.float32)),
    }


def episode(slot):
    return Episode(
        *(SCHEMA_VERSION, 0, slot, 7, "clear", 1, "default", GroundTruthPerception()),
        *("front_right", 16, 9, 70.0, 50_000_000),
    )


def record(folder, drive="all", ticks=3, slot=1):
    """What a simulator tells the recorder of slot 1; the slot and the recorder."""
    recorder = DriveRecorder(2, "cpu")
    slot = Slot(slot, Lease(token=7, attempt=2, out=str(folder), case=case_of(drive)), 0.0)
    recorder.started(slot)
    for tick in range(ticks):
        message = Tick(
            *(SCHEMA_VERSION, tick, [False, True], [0, 7], [0, tick], [0, tick * 50_000_000]),
            *(["camera"], int(tick == 0)),
        )
        episodes = [episode(slot.index)] if tick == 0 else []
        rig_tick = RigTick(message, {}, sensed(tick), episodes)
        recorder.sensed(rig_tick)
        rig_tick.answered = [None, Command(slot.index, 7, tick, 0.1 * tick, 0.0, 0.0)]
        recorder.commanded(rig_tick)
    return slot, recorder


def end(recorder, slot):
    ended = SlotEnd(None, 1.0)
    recorder.ended(slot, ended)
    return ended.record


def finish(recorder, slot, verdict):
    case = slot.lease.case
    result = Result(case.variation.campaign, case.id, slot.lease.token, "verdict", verdict)
    end(recorder, slot).finish(result)


@pytest.fixture
def path(tmp_path):
    case = case_of("all")
    return tmp_path / "cases" / case.id / "attempt-2" / DRIVE_FILE


def test_everything_comes_back_byte_for_byte(tmp_path, path):
    slot, recorder = record(tmp_path)
    finish(recorder, slot, "collision")
    reader = RecordReader(path.parent)
    assert (reader.head.attempt, reader.head.slots, reader.head.case) == (2, 2, slot.lease.case)
    ticks = list(reader.ticks())
    assert reader.end.verdict == "collision"
    assert (reader.end.ticks, reader.end.cut) == (3, "")
    assert ticks[0].seen.episode == structs.replace(episode(1), slot=0)
    for tick, found in enumerate(ticks):
        assert (found.seen.tick, found.seen.sim_time_ns) == (tick, tick * 50_000_000)
        assert found.answer.command.throttle == 0.1 * tick
        given = sensed(tick)
        assert list(found.seen.sensors) == list(given)
        for name, array in found.seen.sensors.items():
            values = given[name].values[1]
            assert decoded(array).tobytes() == values.tobytes(), name
            assert decoded(array).dtype == values.dtype
            assert decoded(array).shape == values.shape
        assert found.seen.sensors["boxes"].count == 1
    assert {a.coding for a in ticks[0].seen.sensors.values()} == {"png", "raw", "zlib"}


def test_the_reader_of_the_documentation_reads_it(tmp_path, path):
    slot, recorder = record(tmp_path)
    finish(recorder, slot, "collision")
    page = Path(__file__).parents[4] / "docs/drive-plane.md"
    below = page.read_text().partition("## The record of a drive\n")[2]
    reader = {}
    exec(below.partition("```python\n")[2].partition("```")[0], reader)
    blocks = list(reader["blocks"](path))
    assert [b["block"] for b in blocks] == ["head", *["seen", "answer"] * 3, "end"]
    for tick, block in enumerate(b for b in blocks if b["block"] == "seen"):
        for name, array in block["sensors"].items():
            values = sensed(tick)[name].values[1]
            assert reader["array"](array).tobytes() == values.tobytes()


def test_a_file_that_was_cut_off_anywhere_is_read_up_to_there(tmp_path, path):
    slot, recorder = record(tmp_path)
    recorder.withdrawn(slot)
    recorder.drain(60)
    whole = path.read_bytes()
    counts = set()
    for size in [*range(len(whole) - 1, 0, -97), len(whole)]:
        path.write_bytes(whole[:size])
        try:
            reader = RecordReader(path)
        except UsageError as error:  # not even the head is there
            assert "no record of a drive" in str(error)  # noqa: PT017
            continue
        ticks = list(reader.ticks())
        assert reader.end is None
        assert [t.seen.tick for t in ticks] == list(range(len(ticks)))
        assert all(t.answer is not None for t in ticks[:-1])
        counts.add(len(ticks))
    assert counts == {0, 1, 2, 3}


def test_a_damaged_file_is_refused_in_one_line(tmp_path, path):
    slot, recorder = record(tmp_path)
    finish(recorder, slot, "pass")
    whole = path.read_bytes()
    for damaged in (
        whole[:300] + bytes([whole[300] ^ 1]) + whole[301:],
        whole.replace(b"IDAT", b"IDBT", 1),
        b"\xff\xff\xff\xff" + whole,
        b"PK\x03\x04 something else",
    ):
        path.write_bytes(damaged)
        with pytest.raises(UsageError, match=r"damaged|no record"):
            list(RecordReader(path).ticks())
    with pytest.raises(UsageError, match="no such record"):
        RecordReader(tmp_path)


def test_what_passed_is_not_kept_if_nobody_wants_it(tmp_path, path):
    for verdict, kept in (("pass", False), ("collision", True)):
        slot, recorder = record(tmp_path, "failed")
        finish(recorder, slot, verdict)
        assert path.exists() == kept


def test_a_case_that_asks_for_none_has_none(tmp_path):
    slot, recorder = record(tmp_path, "none")
    assert end(recorder, slot) is None
    assert list(tmp_path.iterdir()) == []
    other = case_of("all")
    assert case_digest(slot.lease.case) == case_digest(other)
    assert rig_key(slot.lease.case) == rig_key(other)


def test_a_full_disk_ends_the_record_and_not_the_case(tmp_path, path, monkeypatch, capfd):
    write = RecordWriter.write

    def full(self, block):
        if self.ticks == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, block)

    monkeypatch.setattr(RecordWriter, "write", full)
    slot, recorder = record(tmp_path)
    finish(recorder, slot, "pass")
    assert "No space left on device" in capfd.readouterr().err
    reader = RecordReader(path)
    assert len(list(reader.ticks())) == 2
    assert reader.end is None


def test_a_record_that_cannot_begin_is_not_left_behind(tmp_path, path, monkeypatch, capfd):
    """``devkit replay`` of the campaign's folder would end at it."""

    def full(self, block):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RecordWriter, "write", full)
    slot, recorder = record(tmp_path)
    finish(recorder, slot, "pass")
    assert "No space left on device" in capfd.readouterr().err
    assert not path.exists()


def test_a_long_attempt_is_cut_off_and_says_so(tmp_path, path, monkeypatch):
    monkeypatch.setattr("twin.rig.attempt_record.FILE_BYTES_MAX", 4000)
    slot, recorder = record(tmp_path, ticks=40)
    finish(recorder, slot, "pass")
    reader = RecordReader(path)
    found = list(reader.ticks())
    assert 0 < len(found) < 40
    assert reader.end.ticks == len(found)
    assert "at most" in reader.end.cut
    assert FILE_BYTES_MAX == 2 << 30  # as docs/stack.md says


def test_arrays_of_all_shapes():
    random = np.random.default_rng(1)
    for values in (
        random.integers(0, 256, (180, 320, 3), np.uint8),
        random.integers(0, 256, (1, 1, 3), np.uint8),
        random.integers(0, 16, (36, 64), np.uint8),
        random.normal(size=(64, 7)).astype(">f8"),
        np.zeros((0, 7), np.float32),
        np.arange(400)[::-2],
    ):
        found = decoded(coded(values))
        assert found.dtype == values.dtype.newbyteorder("<")
        assert np.array_equal(found, values)


def test_a_record_wants_every_sensor_while_it_is_written(tmp_path):
    recorder = DriveRecorder(2, "cpu")
    assert recorder.wanted() == frozenset()
    unrecorded = Slot(0, Lease(token=3, attempt=1, out=str(tmp_path), case=case_of("none")), 0.0)
    recorder.started(unrecorded)
    assert recorder.wanted() == frozenset()
    slot, recorder = record(tmp_path)
    assert recorder.wanted() is None
    end(recorder, slot)
    assert recorder.wanted() == frozenset()


def test_pictures_are_exact_without_opencv_too(monkeypatch):
    picture = np.random.default_rng(3).integers(0, 256, (9, 16, 3), np.uint8)
    by_opencv = coded(picture)
    monkeypatch.setitem(sys.modules, "cv2", None)
    by_pillow = coded(picture)
    assert by_pillow.coding == by_opencv.coding == "png"
    assert by_pillow.data != by_opencv.data, "it was another program"
    for array in (by_opencv, by_pillow):
        assert np.array_equal(decoded(array), picture)
