"""The simulator's view feed on the in-memory bus: never waits, numbers everything."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from schemas import topics
from schemas.campaign import expand, parse_campaign
from schemas.messages import Command, Lease
from schemas.view import CameraSample, CaseEnd, CaseStart, StateSample, Thumbnail, ViewMode
from schemas.wire import decode
from twin.fabric.memory_bus import Hub
from twin.kpi.recorder import Recorder
from twin.vehicle.state import COLUMN
from twin.worker import view_feed
from twin.worker.view_feed import NoFeed, ViewFeed, _Harmless

RIG = "r1"
IMAGE = np.zeros((2, 36, 64, 3), np.uint8)


def lease(token=5):
    campaign, _ = parse_campaign(
        {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}, "camera": {"width": 64}}
    )
    return Lease(token=token, attempt=1, out="/out", case=expand(campaign)[0])


class Sim:
    """Stands for the engine: two slots, a tick at a time."""

    def __init__(self):
        self.tick = np.zeros(2, np.int32)
        self.sim_time_ns = np.zeros(2, np.int64)
        self.state = np.zeros((2, len(COLUMN)))
        self.colliders = np.array([[234.0, 0.0, 0.0, 2.25, 0.9]])
        self.cars = 1
        self.recorder = Recorder()

    def sensed(self):
        boxes = np.zeros((2, 32, 7), np.float32)
        return {
            "camera": SimpleNamespace(values=IMAGE, count=None),
            "boxes": SimpleNamespace(values=boxes, count=np.array([1, 0])),
        }

    def command(self, token=5):
        return Command(0, token, int(self.tick[0]), 0.5, 0.0, 0.0)

    def step(self, feed, token=5, camera=True):
        command = self.command(token)
        self.recorder.add(int(self.tick[0]), int(self.sim_time_ns[0]), self.state[0], command)
        feed.tick(self, self.sensed() if camera else {}, [command, None])
        self.tick[0] += 1
        self.sim_time_ns[0] += 50_000_000

    def finished(self):
        self.recorder.add(int(self.tick[0]), int(self.sim_time_ns[0]), self.state[0], None)
        return SimpleNamespace(
            slot=0,
            outcome="verdict",
            verdict="pass",
            passed=True,
            reasons=[],
            scalars={"ticks": 3},
            table=self.recorder.table(),
        )


@pytest.fixture
def hub():
    hub = Hub()
    pump = hub.run()
    yield hub
    hub.stop()
    pump.join()


class Listener:
    """Everything of the view plane, decoded."""

    def __init__(self, hub, keys=("view/**",), recorder=False):
        self.got = []
        self.ended = threading.Event()
        self.bus = hub.open()
        for key in keys:
            self.bus.subscribe(key, self.receive)
        self.bus.subscribe(topics.FEED_END.key.format(rig=RIG), lambda _: self.ended.set())
        if recorder:
            self.bus.announce(topics.RECORDER_ALIVE.key.format(rig=RIG))

    def receive(self, sample):
        stream = sample.key.rsplit("/", 1)[1]
        kind, data = {
            "start": (CaseStart, sample.payload),
            "state": (StateSample, sample.payload),
            "camera": (CameraSample, sample.attachment),
            "end": (CaseEnd, sample.payload),
            "thumbnail": (Thumbnail, sample.attachment),
        }[stream]
        self.got.append(decode(data, kind))

    def wait(self):
        assert self.ended.wait(20)
        return self.got


def until(condition):
    """Wait for what other threads do."""
    end_s = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.001)


def test_everything_in_order_with_running_numbers(hub):
    listener = Listener(hub, ["view/*/*/*"], recorder=True)
    feed = ViewFeed(hub.open(), RIG, 2, ViewMode.record)
    sim = Sim()
    feed.begin(0, lease(), sim)
    for tick in range(3):
        sim.step(feed, camera=tick != 1)
    feed.end(sim.finished())
    feed.close(10)
    got = listener.wait()
    assert [type(m).__name__ for m in got] == [
        *("CaseStart", "CameraSample", "StateSample", "StateSample", "CameraSample"),
        *("StateSample", "StateSample", "CaseEnd"),
    ]
    assert [m.seq for m in got] == list(range(8))
    assert got[-1].samples == 8
    assert got[-1].verdict == "pass"
    assert [m.tick for m in got if isinstance(m, StateSample)] == [0, 1, 2, 3]
    assert got[-2].controls is None, "the last row has no command"
    assert got[3].boxes is None
    assert len(got[2].boxes) == 1
    assert got[0].folder == "/out/cases/clear/attempt-1"


def test_a_recorder_that_comes_later_misses_nothing(hub):
    bus = hub.open()
    feed = ViewFeed(bus, RIG, 2, ViewMode.record)
    sim = Sim()
    feed.begin(0, lease(), sim)
    for _ in range(3):
        sim.step(feed)
    listener = Listener(hub, recorder=True)
    feed.end(sim.finished())
    feed.close(10)
    assert [m.seq for m in listener.wait()] == list(range(9))


def test_overflow_leaves_a_gap_and_the_verdict(hub, monkeypatch):
    monkeypatch.setattr(view_feed, "QUEUE_BYTES_MAX", 3 * (IMAGE[0].nbytes + 1024))
    feed = ViewFeed(hub.open(), RIG, 2, ViewMode.record)
    sim = Sim()
    feed.begin(0, lease(), sim)
    for _ in range(10):
        sim.step(feed)  # nobody takes: returns at once all the same
    feed.end(sim.finished())
    listener = Listener(hub, recorder=True)
    feed.close(10)
    got = listener.wait()
    assert [m.seq for m in got] == [0, 1, 2, 3, 4, 5, 6, 21, 22]
    assert got[-1].samples == 23


def test_a_recorder_that_went_and_came_back_sees_what_it_missed(hub):
    first = Listener(hub, recorder=True)
    feed = ViewFeed(hub.open(), RIG, 2, ViewMode.record)
    sim = Sim()
    feed.begin(0, lease(), sim)
    sim.step(feed)
    until(lambda: len(first.got) == 3)
    first.bus.close()
    until(lambda: feed._recorder_gone)
    sim.step(feed)  # not sent, not copied, but counted
    second = Listener(hub, recorder=True)
    until(lambda: not feed._recorder_gone)
    sim.step(feed)
    feed.end(sim.finished())
    feed.close(10)
    assert [m.seq for m in second.wait()] == [5, 6, 7, 8]


def test_thumbnails_only_for_those_who_look(hub):
    feed = ViewFeed(hub.open(), RIG, 2, ViewMode.live)
    sim = Sim()
    feed.begin(0, lease(), sim)
    sim.step(feed)
    listener = Listener(hub, ["view/*/*/thumbnail"])
    for _ in range(3):
        sim.step(feed)
    feed.end(sim.finished())
    feed.close(10)
    got = listener.wait()
    assert len(got) == 2, "one at first, one with the verdict: the others came too soon"
    assert [m.outcome for m in got] == ["", "verdict"]
    assert [m.sim_time_ns for m in got] == [50_000_000, 200_000_000]


def test_nobody_looks(hub):
    bus = hub.open()
    published = []
    bus.publish = lambda key, *_, **__: published.append(key)
    feed = ViewFeed(bus, RIG, 2, ViewMode.live)
    sim = Sim()
    feed.begin(0, lease(), sim)
    for _ in range(3):
        sim.step(feed)
    feed.end(sim.finished())
    feed.close(10)
    assert published == [topics.FEED_END.key.format(rig=RIG)]


def test_an_abandoned_case_ends_without_outcome(hub):
    listener = Listener(hub, recorder=True)
    feed = ViewFeed(hub.open(), RIG, 2, ViewMode.record)
    sim = Sim()
    feed.begin(0, lease(), sim)
    sim.step(feed)
    feed.abandon(0)
    feed.abandon(1)
    feed.close(10)
    got = listener.wait()
    assert [m.seq for m in got] == [0, 1, 2, 3]
    assert got[-1].outcome == ""


def test_a_feed_that_fails_fails_alone(capsys):
    class Broken(NoFeed):
        def tick(self, *_):
            raise RuntimeError("out of luck")

    feed = _Harmless(Broken())
    feed.tick(None, {}, [])
    feed.tick(None, {}, [])
    feed.close(0)
    assert capsys.readouterr().err.count("Traceback") == 1
