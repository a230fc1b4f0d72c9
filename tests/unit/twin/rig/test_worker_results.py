"""Results are written in order on a thread; what keeps one from it reaches the loop."""

import os
import queue
import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import structs
from waiting import PATIENCE_S

from conductor.run.source import load
from schemas.messages import PerceptionCost
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease
from twin.base.errors import TwinError
from twin.kpi.recorder import KpiRecorder
from twin.rig.drive_recorder import DriveRecorder
from twin.rig.pipe import Progress, Unpacker, Upstream, Upward
from twin.rig.profile import LoopLog, LoopProfile
from twin.rig.results import ResultWriter
from twin.rig.simulator import Simulator
from twin.rig.slot import Finished, Slot, SlotEnd
from twin.vehicle.state import COLUMN


def ended(folder: Path, token: int) -> tuple[Slot, SlotEnd]:
    recorder = KpiRecorder(1)
    state = np.zeros((1, len(COLUMN)))
    recorder.add([0], np.array([token]), np.array([0]), state, [None], [{}])
    finished = Finished(0, "verdict", "pass", [], {}, recorder.of(0).table())
    lease = Lease(token, 1, str(folder), load("chaos-16").cases[token])
    slot = Slot(0, lease, 0.0, perception=PerceptionCost("numpy cpu", 3, 0.5), rig_wall_s=0.25)
    return slot, SlotEnd(finished, 12.5)


def test_they_come_in_order_and_their_files_are_there(tmp_path):
    told: queue.Queue = queue.Queue()
    writer = ResultWriter(lambda _, result: told.put(result))
    for token in range(5):
        writer.ended(*ended(tmp_path, token))
    results = [told.get(timeout=PATIENCE_S) for _ in range(5)]
    assert [result.token for result in results] == list(range(5))
    assert all((tmp_path / result.attempt_dir / "kpi.parquet").exists() for result in results)
    assert {result.rig_wall_s for result in results} == {0.25}
    assert {result.wall_s for result in results} == {12.5}, "the wait for the disk is no part"
    assert results[0].perception.frames == 3


def test_a_folder_that_cannot_be_written_ends_the_loop(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    writer = ResultWriter(lambda *_: pytest.fail("it was not written"))
    writer.ended(*ended(blocked, 0))
    with pytest.raises(TwinError, match="Not a directory"):
        until_refused(writer)


def test_the_end_of_a_rig_waits_for_cases_that_are_over(tmp_path):
    go_on, told = threading.Event(), []

    def tell(_, result):
        go_on.wait(PATIENCE_S)
        told.append(result.token)

    writer = ResultWriter(tell)
    assert writer.drain(0.0)
    for token in (0, 1):
        writer.ended(*ended(tmp_path, token))
    assert writer.tokens == [0, 1]
    assert not writer.drain(0.01)
    go_on.set()
    assert writer.drain(PATIENCE_S)
    assert (told, writer.tokens) == ([0, 1], [])


def test_what_cannot_be_written_keeps_nobody_waiting(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    writer = ResultWriter(lambda *_: pytest.fail("it was not written"))
    writer.ended(*ended(blocked, 0))
    assert writer.drain(PATIENCE_S)
    with pytest.raises(TwinError):
        writer.check()


class StoppedError(Exception):
    """What ends the loop below."""


def test_a_simulator_that_breaks_tells_first_what_was_over(tmp_path, monkeypatch):
    read, write = os.pipe()
    simulator = Simulator.__new__(Simulator)
    go_on = threading.Event()
    simulator._inline = None
    simulator._recorder = DriveRecorder(1, "cpu")
    simulator._upward = Upstream(os.fdopen(write, "wb", buffering=0))

    def tell(end, result):
        go_on.wait(PATIENCE_S)
        simulator._written(end, result)

    simulator._results = ResultWriter(tell)

    def loop():
        simulator._results.ended(*ended(tmp_path, 3))
        go_on.set()
        raise StoppedError

    monkeypatch.setattr(simulator, "_loop", loop)
    with pytest.raises(StoppedError):
        simulator.run()
    done, progress = Unpacker(Upward).feed(os.read(read, 65536))
    assert (done.result.token, progress) == (3, Progress([], []))


def until_refused(writer: ResultWriter) -> None:
    """The first look after it has failed raises."""
    for _ in range(100_000):
        writer.check()
        threading.Event().wait(0.001)


def test_the_profile_of_a_loop_has_its_last_tick(tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_PROFILE", str(tmp_path))
    log = LoopLog("r", "cpu", 4)
    log.transport = "memory"
    log.write(now=True)
    assert not list(tmp_path.iterdir()), "nothing has happened yet"
    for active in (4, 3, 3, 1):
        log.begin_tick()
        log.watch.lap("physics")
        log.end_tick(active, 2 * active, 50_000_000)
    counted = dict(log.watch.seconds)
    log.watch.lap("idle")
    log.write(now=True)
    found = msgspec.json.decode((tmp_path / "r.json").read_bytes(), type=LoopProfile)
    assert (found.ticks, found.frames, found.sim_s) == (4, 22, pytest.approx(0.55))
    assert found.first_tick_s <= found.full_s < found.last_tick_s
    assert found.seconds == counted, "what comes after the last tick is no part of the loop"
    assert [(each.ticks, each.slot_ticks) for each in found.quarters] == [
        *((1, 1), (0, 0), (2, 6), (1, 4))
    ]
    together = sum(each.seconds.get("physics", 0.0) for each in found.quarters)
    assert together == pytest.approx(counted["physics"])
    assert decode(encode(structs.replace(found)), LoopProfile) == found
