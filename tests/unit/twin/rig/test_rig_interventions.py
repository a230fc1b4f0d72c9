"""Steering an engine: requests from other threads, applied between two ticks."""

import errno
import os
import threading
import time

import pytest
from case_changes import changed
from unit.twin.rig.test_engine import ask, case

from schemas import SCHEMA_VERSION
from schemas.messages import SensorErrors
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Explain, Lease, Reply, StatusRequest
from schemas.wire.interventions import (
    JOURNAL_FILE,
    ControlReply,
    ControlRequest,
    GiveBack,
    MoveObject,
    Pause,
    PlaceEgo,
    Query,
    SetEnvironment,
    SetPace,
    SetSensors,
    SpawnObject,
    Step,
    Takeover,
    Together,
)
from twin.base.errors import UnreachableError, UsageError
from twin.fabric.interventions import Attempt, carry_out, find, find_in_rig
from twin.fabric.memory_bus import MemoryHub
from twin.rig.engine import Engine
from twin.rig.interventions.journal import read_journal
from twin.rig.interventions.listener import REQUEST_BYTES_MAX, WAITING_MAX, RigInterventions
from twin.rig.interventions.slot_changes import SlotChanges
from twin.rig.slot import RigTick, Slot, Slots

SILENCE_S = 3600.0


class Rig:
    """An engine of two slots with its interventions; a turn is what the simulator's loop does."""

    def __init__(self, folder):
        self.folder = folder
        self.engine = Engine(case("a"), 2)
        self.slots = Slots(2)
        self.notes = []
        self.interventions = RigInterventions("rig", 2, "cpu", self.tell)
        self.interventions.built(self.engine)
        self.changes_of = SlotChanges(self.engine, "rig")
        for index, name in enumerate("ab"):
            self.begin(index, 7 + index, case(name))

    def begin(self, index, token, one):
        self.engine.reset(index, one)
        slot = Slot(index, Lease(token, 1, str(self.folder), one), 0.0)
        if (earlier := self.slots[index]) is not None:
            self.slots.leave(earlier)
        self.slots.take(slot)
        self.interventions.started(slot)

    def tell(self, slot, attempt):
        self.notes.append((slot.index, attempt.note.what, attempt.label()))

    def turn(self, throttle=0.1):
        """At most one tick; what was commanded."""
        self.interventions.turn()
        if not self.engine.active.any():
            self.interventions.nap()
            return [None, None]
        self.engine.sense()
        active = self.engine.active
        tick = RigTick(None, {}, {}, [])
        tick.answered = [ask(self.engine, s, throttle) if active[s] else None for s in range(2)]
        self.interventions.commanded(tick)
        self.engine.step(tick.commands)
        return tick.commands

    def do(self, action, slot=0, id_="", **more):
        """Ask, as a viewer does, and take a turn; the answer."""
        answers = []
        request = ControlRequest(v=SCHEMA_VERSION, id=id_, action=action, **more)
        self.interventions.ask(slot, encode(request), answers.append)
        if not answers:
            self.turn()
        return decode(answers[0], ControlReply)

    def weather(self, slot):
        return self.changes_of.weather(slot)

    def changes(self, slot):
        return self.do(Query(), slot).state.changes

    @property
    def ticks(self):
        return self.engine.tick.tolist()


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """On a slow machine two turns may be further apart than a driver may be silent."""
    monkeypatch.setattr("twin.rig.interventions.case.DRIVE_SILENCE_S", SILENCE_S)
    return Rig(tmp_path)


def test_a_slot_stands_while_the_other_goes_on_and_comes_back_in_phase(rig):
    rig.turn()
    assert rig.do(Pause()).tick == 1
    assert [slot.index for slot in rig.slots.running] == [1]
    assert [slot.index for slot in rig.slots.held] == [0]
    for _ in range(3):
        rig.turn()
    assert rig.ticks == [1, 5]
    # Cameras are due every second tick: a step at tick 1 waits for an odd tick of the other.
    assert rig.do(Step(2)).tick == 1
    for _ in range(5):
        rig.turn()
    assert rig.ticks == [3, 11]
    assert rig.notes == [(0, "pause", "paused"), (0, "step ticks=2", "paused")]
    rig.do(Pause(), slot=1)
    before = rig.ticks
    for _ in range(3):
        rig.turn()
    assert rig.ticks == before, "nothing runs"
    assert rig.changes(0) == 0


def test_a_takeover_is_journalled_as_it_changes(rig, tmp_path):
    assert rig.do(Takeover(0.3, 0.0, 0.1)).tick == 0
    rig.do(SetPace(1000.0))
    assert rig.do(Takeover(0.3, 0.0, 0.1)).state.changes == 1, "the same pedals"
    commands = rig.turn()
    assert (commands[0].throttle, commands[0].steering_rad, commands[1].throttle) == (0.3, 0.1, 0.1)
    rig.do(Takeover(0.0, 0.5, 0.0))
    assert rig.do(GiveBack()).state.changes == 3
    assert rig.do(GiveBack()).state.changes == 3, "nothing to give back"
    assert rig.turn()[0].throttle == 0.1
    head, entries, end = read_journal(tmp_path / "cases" / "a" / "attempt-1")
    assert (head.case, head.slots, end) == (case("a"), 2, None)
    assert [type(entry.action) for entry in entries] == [Takeover, Takeover, GiveBack]
    assert [told for _, told, _ in rig.notes] == ["takeover", "pace factor=1000", "release"]


def test_a_request_that_comes_twice_is_done_once(rig):
    first = rig.do(Takeover(0.3), id_="x")
    again = rig.do(Takeover(0.9), id_="x")
    assert again == first
    assert rig.changes(0) == 1


def test_what_is_refused_changes_nothing(rig, tmp_path):
    assert "that attempt has ended, attempt 1 runs now" in rig.do(Pause(), token=6).error
    assert "weather 'fog': allowed" in rig.do(SetEnvironment("fog")).error
    assert "kind: given 'horse'" in rig.do(SpawnObject("horse", 0.0, 0.0)).error
    answers = []
    rig.interventions.ask(0, b"x" * (REQUEST_BYTES_MAX + 1), answers.append)
    rig.interventions.ask(0, b"garbage", answers.append)
    old = encode(ControlRequest(v=SCHEMA_VERSION + 1, id="", action=Query()))
    rig.interventions.ask(0, old, answers.append)
    errors = [decode(answer, ControlReply).error for answer in answers]
    for error, words in zip(errors, ("at most 4096", "not MessagePack", "version"), strict=True):
        assert words in error
    assert (rig.changes(0), rig.notes) == (0, [])
    assert not list(tmp_path.glob("cases/*/*/*")), "no journal of nothing"
    blocked = tmp_path / "cases" / "b"
    blocked.parent.mkdir(parents=True, exist_ok=True)
    blocked.write_text("a file where a folder should be")
    assert "cannot be journalled" in rig.do(SetEnvironment("heavy_fog"), slot=1).error
    assert rig.weather(1) == "clear"


def test_a_full_disk_refuses_what_steers_and_the_rig_goes_on(rig, tmp_path, monkeypatch):
    rig.do(Takeover(0.3))
    journal = tmp_path / "cases" / "a" / "attempt-1"
    before = read_journal(journal)
    write = os.write

    def nearly_full(descriptor, data):
        if len(data) > 10:
            return write(descriptor, data[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", nearly_full)
    assert "cannot be journalled" in rig.do(SetEnvironment("heavy_fog")).error
    assert "cannot be journalled" in rig.do(SetEnvironment("heavy_fog"), slot=1).error
    assert [rig.weather(slot) for slot in range(2)] == ["clear", "clear"]
    rig.interventions._open[0].attempt.drive_s -= SILENCE_S
    rig.turn()
    assert rig.do(Query()).state.taken_over, "what is not journalled is not done"
    assert read_journal(journal) == before
    assert not (tmp_path / "cases" / "b" / "attempt-1" / JOURNAL_FILE).exists()
    monkeypatch.undo()
    rig.turn()
    assert not rig.do(Query()).state.taken_over
    assert "weather 'fog'" in rig.do(SetEnvironment("fog")).error
    rig.do(SetEnvironment("heavy_fog"))
    _, entries, _ = read_journal(journal)
    assert [type(each.action) for each in entries] == [Takeover, GiveBack, SetEnvironment]
    assert rig.changes(0) == 3


def test_a_flood_is_refused(rig):
    answers = []
    request = encode(ControlRequest(v=SCHEMA_VERSION, id="", action=Query()))
    for _ in range(WAITING_MAX + 1):
        rig.interventions.ask(0, request, answers.append)
    assert "requests wait already" in decode(answers[0], ControlReply).error
    rig.turn()
    assert len(answers) == WAITING_MAX + 1


def test_over_the_rigs_own_key_and_through_the_view_plane(rig):
    hub = MemoryHub()
    pump, stop = hub.run(), threading.Event()
    simulator, viewer = hub.open(), hub.open()
    key = topics.CONTROL.key.format(rig="rig")
    simulator.serve(key, lambda p, r: rig.interventions.ask(None, p, r))
    view = topics.VIEW_CONTROL.key.format(campaign="test", case="b")
    cancel = simulator.serve(view, lambda p, r: rig.interventions.ask(1, p, r))

    def loop():
        while not stop.is_set():
            rig.interventions.turn()
            time.sleep(0)

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        assert find_in_rig(viewer, "rig", case="a").state.case == "a"
        assert find_in_rig(viewer, "rig", slot=1).do(Pause()).tick == 0
        with pytest.raises(UsageError, match="case 'c' does not run in this rig; running: a, b"):
            find_in_rig(viewer, "rig", case="c")
        found = find(viewer, "b")
        wrong = [SetPace(2.0), PlaceEgo(1.0, 2.0, 0.0), SetEnvironment("fog")]
        with pytest.raises(UsageError, match=r"fog.*allowed"):
            list(carry_out(found, wrong))
        state = found.do(Query()).state
        assert (state.pace, state.changes, state.weather) == (None, 0, "clear")
        with pytest.raises(UsageError, match=r"given 99.*; done before it: pace at tick 0$"):
            list(carry_out(found, [SetPace(1000.0), MoveObject(99, 0.0, 0.0)]))
        assert not list(rig.folder.glob("cases/b/*/*"))
        with pytest.raises(UsageError, match="a case's name: given 'b/\\*'"):
            find(viewer, "b/*")
        assert found.do(Query()).state.pace == 1000.0
        assert (found.state.paused, found.state.token) == (True, 8)
        with pytest.raises(UsageError, match="that attempt has ended"):
            Attempt(viewer, "test", "b", 5).do(Pause())
        cancel()
        with pytest.raises(UnreachableError, match="no conductor answers there"):
            find(viewer, "b")
        lines = {"b": "leased to w since 4 s", "c": "waits: the case is paused"}
        simulator.serve(topics.RPC_STATUS.key, lambda p, r: r(encode(_conductor(p, lines))))
        with pytest.raises(UsageError, match="cannot be steered: its rig is just starting, or sho"):
            find(viewer, "b")
        with pytest.raises(UsageError, match="does not run: waits: the case is paused"):
            find(viewer, "c")
        with pytest.raises(UsageError, match="no case 'd' in test"):
            find(viewer, "d")
    finally:
        stop.set()
        thread.join()
        hub.stop()
        pump.join()


def _conductor(payload, lines):
    """What a conductor says of the campaign ``test``."""
    request = decode(payload, Explain | StatusRequest)
    if isinstance(request, StatusRequest):
        return Reply(v=SCHEMA_VERSION, epoch=1, status={"campaigns": {"test": {}}})
    if request.case not in lines:
        return Reply(v=SCHEMA_VERSION, epoch=1, error="no case")
    return Reply(v=SCHEMA_VERSION, epoch=1, status={"explain": [lines[request.case]]})


def test_a_case_that_goes_by_the_wall_clock_cannot_be_held(tmp_path):
    rig = Rig(tmp_path)
    paced = changed(case("a"), clock="realtime")
    rig.begin(0, 7, paced)
    for action in (Pause(), Step(3), SetPace(0.5)):
        assert rig.do(action).error.startswith("clock realtime: the case goes with the wall clock")
    assert rig.do(SetEnvironment(weather="heavy_rain")).error == ""
    assert not rig.slots.held


def test_settings_of_one_request_are_done_together_or_not_at_all(rig):
    night = SetEnvironment(time_of_day_min=1350.0)
    there = PlaceEgo(120.0, 1.5, 0.1)
    lost = SetSensors(SensorErrors(gnss_dropout=True))  # the case has no receiver
    before = rig.do(Query()).state
    refused = rig.do(Together([night, there, SetPace(2.0), lost]))
    assert "gnss" in refused.error
    after = rig.do(Query()).state
    assert (after.changes, after.pace) == (0, None)
    # The ego stands where it would stand anyhow, and it is as light as before.
    assert (round(after.x_m), after.time_of_day_min) == (round(before.x_m), before.time_of_day_min)
    assert not list(rig.folder.glob("cases/a/*"))
    done = rig.do(Together([night, there, SetPace(1000.0)]), id_="x")
    assert done.error == ""
    assert (done.state.changes, done.state.pace) == (2, 1000.0)
    assert (done.state.x_m, done.state.time_of_day_min) == (pytest.approx(120.0), 1350.0)
    assert rig.do(Together([night, there]), id_="x").tick == done.tick  # asked again, done once
    assert rig.notes[-1][1] == (
        "environment time_of_day_min=1350, pose x_m=120 y_m=1.5 yaw_rad=0.1 speed_mps=0, "
        "pace factor=1000"
    )
    _, entries, _ = read_journal(next(rig.folder.glob("cases/a/attempt-1")))
    assert [(each.tick, each.action) for each in entries] == [
        (done.tick, night),
        (done.tick, there),
    ]
