"""The simulator's view view on the in-memory bus: never waits, numbers everything."""

import hashlib
import threading
import zlib
from types import SimpleNamespace

import cv2
import msgspec
import numpy as np
import pytest
from case_changes import changed
from waiting import PATIENCE_S, wait_for

from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.wire import topics
from schemas.wire.codec import decode
from schemas.wire.control import Lease
from schemas.wire.view import (
    UNNUMBERED,
    CameraSample,
    CaseEnd,
    CaseStart,
    ClockReading,
    PointsSample,
    RecorderBatch,
    SceneMesh,
    StateSample,
    Thumbnail,
    ViewMode,
)
from twin.actors.motion import Still
from twin.kpi.recorder import KpiRecorder
from twin.rig.slot import Finished, RigTick, Slot, SlotEnd
from twin.sensors.data import SensorData
from twin.vehicle.state import COLUMN
from twin.view import encoder as view_encoder
from twin.view import publisher
from twin.view.demand import Demand
from twin.view.items import SlotRun
from twin.view.port import GuardedView, NoView
from twin.view.publisher import ViewPublisher
from twin.view.samples import THUMBNAIL_WIDTH_PX
from twin.world.meshes.mesh import MeshBuilder
from twin.world.scene import load_scene
from twin.world.street.build import World, build_world

RIG = "r1"
IMAGE = np.zeros((2, 36, 64, 3), np.uint8)


def lease(token=5):
    campaign, _ = parse_campaign(
        {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}, "camera": {"width": 64}}
    )
    return Lease(token=token, attempt=1, out="/out", case=expand(campaign)[0])


def world():
    """A box on a street that is not there."""
    mesh = MeshBuilder()
    mesh.box((0, 0, 0), (1, 1, 1), 0, (0.5, 0.1, 0.1), top=(0, (0.1, 0.5, 0.1)))
    hull = np.array([[234.0, 0.0, 0.0, 2.25, 0.9]])
    return World(mesh.build(), hull, 1, (0.0, 0.0), (0.0, 0.0), cars=1)


class Sim:
    """Stands for the engine: two slots, a tick at a time."""

    def __init__(self):
        self.active = np.array([True, False])
        self.tick = np.zeros(2, np.int32)
        self.sim_time_ns = np.zeros(2, np.int64)
        self.state = np.zeros((2, len(COLUMN)))
        self.world = world()
        self.colliders, self.cars = self.world.colliders, self.world.cars
        self.target = lambda slot: self.world.obstacle
        self.closest = lambda slot: None
        self.placement = Still().at(np.zeros(2))
        self.camera_sites, self.lidar_sites = [], []
        self.recorder = KpiRecorder(2)
        self.more = {}

    def sensed(self):
        """Camera and boxes; the lidar's second ray found nothing, its third is too far away."""
        points = np.zeros((2, 3, 7), np.float32)
        points[0, :, 0] = 1.234, np.nan, 400.0
        points[0, :, 4] = 77.0
        boxes = np.zeros((2, 32, 7), np.float32)
        return {
            "camera": SimpleNamespace(values=IMAGE, count=None),
            "boxes": SimpleNamespace(values=boxes, count=np.array([1, 0])),
            "lidar.roof": SimpleNamespace(values=points, count=np.array([2, 0])),
            **self.more,
        }

    def command(self, token=5):
        return Command(0, token, int(self.tick[0]), 0.5, 0.0, 0.0)

    def step(self, view, token=5, camera=True):
        command = self.command(token)
        self.recorder.add([0], self.tick, self.sim_time_ns, self.state, [command], [{}])
        tick = RigTick(None, self.sensed() if camera else {}, {}, [], commands=[command, None])
        view.commanded(tick)
        self.tick[0] += 1
        self.sim_time_ns[0] += 50_000_000

    def begin(self, view, one):
        self.slot = Slot(0, one, 0.0)
        view.built(self)
        view.started(self.slot)

    def end(self, view):
        view.ended(self.slot, SlotEnd(self.finished(), 1.0))

    def finished(self):
        self.recorder.add([0], self.tick, self.sim_time_ns, self.state, [None], [{}])
        return Finished(0, "verdict", "pass", [], {"ticks": 3}, self.recorder.of(0).table())


@pytest.fixture
def clock(monkeypatch):
    """The view's wall clock, which stands still until it is moved."""
    clock = SimpleNamespace(now_s=100.0)
    monkeypatch.setattr(publisher, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    return clock


class Listener:
    """Everything that it is sent, decoded; the recorder's batches in parts."""

    def __init__(self, hub, keys=(), recorder=False):
        self.got = []
        self.batches = 0
        self.payloads = {}
        self.ended = threading.Event()
        self.bus = hub.open()
        for key in keys:
            self.bus.subscribe(key, self.receive)
        self.bus.subscribe(topics.FEED_END.key.format(rig=RIG), lambda _: self.ended.set())
        if recorder:
            self.bus.subscribe(topics.FEED_RECORDED.key.format(rig=RIG), self.record)
            self.bus.announce(topics.RECORDER_ALIVE.key.format(rig=RIG))

    def record(self, sample):
        self.batches += 1
        for part in decode(sample.payload, RecorderBatch).samples:
            found = [m for m in (part.start, part.camera, part.state, part.end) if m is not None]
            assert len(found) == 1
            assert bool(part.jpeg) == isinstance(found[0], CameraSample)
            self.got += found

    def receive(self, sample):
        stream = sample.key.rsplit("/", 1)[1]
        self.payloads[stream] = sample.payload
        kind, data = {
            "lidar.roof": (PointsSample, sample.attachment),
            "start": (CaseStart, sample.payload),
            "state": (StateSample, sample.payload),
            "radar_cube": (CameraSample, sample.attachment),
            "camera": (CameraSample, sample.attachment),
            "end": (CaseEnd, sample.payload),
            "thumbnail": (Thumbnail, sample.attachment),
        }[stream]
        self.got.append(decode(data, kind))

    def wait(self):
        assert self.ended.wait(PATIENCE_S)
        return self.got


def test_everything_in_order_with_running_numbers(hub):
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    for tick in range(3):
        sim.step(view, camera=tick != 1)
    sim.end(view)
    view.close(10)
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


def test_a_recording_gets_whatever_moves(hub):
    """A pedestrian and a van of the shipped crossing, as the engine places them."""
    crossing = build_world(load_scene("crossing"))
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.world = crossing
    sim.begin(view, lease())
    for _ in range(2):
        sim.placement = crossing.motion.at(sim.sim_time_ns / 1e9 + 5.0)
        sim.step(view, camera=False)
    sim.end(view)
    view.close(10)
    states = [m for m in listener.wait() if isinstance(m, StateSample)]
    assert [len(state.movers) for state in states] == [3, 3, 0]
    walker, _, van = states[0].movers
    assert walker[4:6] == [0.25, 0.25]
    assert van[4] > 2.0
    moved = states[1].movers[0]
    assert np.hypot(moved[0] - walker[0], moved[1] - walker[1]) == pytest.approx(0.07, abs=0.01)


def test_samples_for_the_recorder_travel_together(hub, clock):
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(50):
        sim.step(view)
    sim.end(view)
    view.close(10)
    assert [m.seq for m in listener.wait()] == list(range(103))
    assert listener.batches == 1, (
        "no time has passed: a message per sample costs half a millisecond"
    )


def test_samples_wait_for_others_for_a_while_only(hub):
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    Sim().begin(view, lease())
    wait_for(lambda: len(listener.got) == 1, "the start, though nothing follows")
    assert listener.batches == 1
    view.close(10)


def test_a_recorder_that_comes_later_misses_nothing(hub):
    bus = hub.open()
    view = ViewPublisher(bus, RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(3):
        sim.step(view)
    listener = Listener(hub, recorder=True)
    sim.end(view)
    view.close(10)
    assert [m.seq for m in listener.wait()] == list(range(9))


def test_overflow_leaves_a_gap_and_the_verdict(hub, monkeypatch):
    monkeypatch.setattr(publisher, "QUEUE_BYTES_MAX", 3 * (IMAGE[0].nbytes + 1024))
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(10):
        sim.step(view)  # nobody takes: returns at once all the same
    sim.end(view)
    listener = Listener(hub, recorder=True)
    view.close(10)
    got = listener.wait()
    assert [m.seq for m in got] == [0, 1, 2, 3, 4, 5, 6, 21, 22]
    assert got[-1].samples == 23


def test_a_recorder_that_went_and_came_back_sees_what_it_missed(hub):
    first = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    wait_for(lambda: len(first.got) == 3, "three messages")
    first.bus.close()
    wait_for(lambda: view._recorder_gone, "the end of the recorder")
    sim.step(view)  # not sent, not copied, but counted
    second = Listener(hub, recorder=True)
    wait_for(lambda: not view._recorder_gone, "the second recorder")
    sim.step(view)
    sim.end(view)
    view.close(10)
    assert [m.seq for m in second.wait()] == [5, 6, 7, 8]


def test_thumbnails_only_for_those_who_look(hub, clock):
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    listener = Listener(hub, ["view/*/*/thumbnail"])
    for _ in range(3):
        sim.step(view)
    sim.end(view)
    view.close(10)
    got = listener.wait()
    assert len(got) == 2, "one at first, one with the verdict: the others came too soon"
    assert [m.outcome for m in got] == ["", "verdict"]
    assert [m.sim_time_ns for m in got] == [50_000_000, 200_000_000]


def test_a_case_that_stands_still_says_so_to_those_who_look(hub, clock):
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    asked = []
    view.asks(lambda slot, payload, respond: (asked.append(slot), respond(payload)))
    sim = Sim()
    sim.begin(view, lease())
    key = topics.VIEW_CONTROL.key.format(campaign="*", case="*")
    viewer = hub.open()
    assert viewer.gather(key, b"pause", PATIENCE_S) == [b"pause"]
    assert asked == [0]
    sim.step(view)
    listener = Listener(hub, ["view/*/*/thumbnail", "view/*/*/live/*"])  # it comes too late
    sim.active[0] = False
    for _ in range(3):
        view.label(sim.slot, "paused")
        clock.now_s += 0.3
    sim.step(view)  # of the others: nothing of this one
    view.label(Slot(1, lease(), 0.0), "paused")  # no case there
    sim.active[0] = True
    clock.now_s += 1.0
    sim.step(view)
    sim.end(view)
    assert viewer.gather(key, b"pause", PATIENCE_S) == [], "nobody to ask any more"
    view.close(10)
    got = listener.wait()
    states = [m for m in got if isinstance(m, StateSample)]
    assert [(m.tick, m.hand) for m in states] == [(1, "paused")] * 3 + [(2, "paused"), (3, "")]
    small = [(m.hand, m.outcome) for m in got if isinstance(m, Thumbnail)]
    assert small == [("paused", "")] * 3 + [("paused", "verdict")]
    assert len([m for m in got if isinstance(m, CaseStart)]) == 2


def test_nobody_looks(hub):
    bus = hub.open()
    published = []
    bus.publish = lambda key, *_, **__: published.append(key)
    view = ViewPublisher(bus, RIG, ViewMode.live)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(3):
        sim.step(view)
    sim.end(view)
    view.close(10)
    assert published == [topics.FEED_END.key.format(rig=RIG)]


def test_an_abandoned_case_ends_without_outcome(hub):
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    view.withdrawn(sim.slot)
    view.withdrawn(Slot(1, lease(), 0.0))
    view.close(10)
    got = listener.wait()
    assert [m.seq for m in got] == [0, 1, 2, 3]
    assert got[-1].outcome == ""


def test_a_view_that_fails_fails_alone(capsys):
    class Broken(NoView):
        def commanded(self, *_):
            raise RuntimeError("out of luck")

    view = GuardedView(Broken())
    view.commanded(None)
    view.commanded(None)
    view.close(0)
    assert capsys.readouterr().err.count("Traceback") == 1


def test_a_view_that_failed_answers_nobody(hub, monkeypatch):
    asker = hub.open()
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    guarded = GuardedView(view)
    guarded.asks(lambda slot, payload, respond: respond(b"here"))
    sim = Sim()
    sim.begin(guarded, lease())
    assert asker.gather("view/c/clear/control", b"", PATIENCE_S) == [b"here"]
    monkeypatch.setattr(view, "label", lambda *_: 1 / 0)
    guarded.label(sim.slot, "paused")
    assert asker.gather("view/c/clear/control", b"", 0.2) == []


ALONE = "view/c/clear/live/*"


def test_a_case_in_full_for_those_who_look_at_it_alone(hub, clock):
    listener = Listener(hub, [ALONE])
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(4):
        sim.step(view)
        clock.now_s += 0.06
    sim.end(view)
    view.close(10)
    got = listener.wait()
    assert [type(m).__name__ for m in got] == [
        *("CaseStart", "CameraSample", "PointsSample", "StateSample"),
        *("CameraSample", "StateSample", "StateSample", "CaseEnd"),
    ], "camera and state at 10 Hz of the wall clock, lidar at 5 Hz"
    assert [m.tick for m in got if isinstance(m, StateSample)] == [0, 2, 4]
    assert all(m.seq == UNNUMBERED for m in got if not isinstance(m, PointsSample))
    assert (got[0].rig, len(got[0].scene_sha256)) == (RIG, 64)
    assert got[-1].verdict == "pass"
    points = np.frombuffer(listener.payloads["lidar.roof"], "<i2").reshape(-1, 4)
    assert points.tolist() == [[123, 0, 0, 77]]


def test_detections_travel_in_the_state_and_the_start_says_where_the_radar_sits(hub):
    sections = {"radar": {"position_m": [3.5, 0.5, 0.6], "yaw_deg": 10.0}, "imu": {}}
    campaign, mistakes = parse_campaign(
        {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}, "sensors": sections}
    )
    assert campaign is not None, mistakes
    listener = Listener(hub, recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record)
    sim = Sim()
    rows = np.zeros((2, 128, 6), np.float32)
    rows[0, :2, 0] = 20.0, 30.5
    sim.more["radar"] = SimpleNamespace(values=rows, count=np.array([2, 0]))
    sim.begin(view, msgspec.structs.replace(lease(), case=expand(campaign)[0]))
    sim.step(view)
    sim.more.clear()
    sim.step(view)
    sim.end(view)
    view.close(10)
    start, *rest = listener.wait()
    site = start.rows["radar"]
    assert site.columns[:2] == ["range_m", "azimuth_rad"]
    assert (site.position_m, site.rotation_deg) == ([3.5, 0.5, 0.6], [0.0, 0.0, 10.0])
    states = [m for m in rest if isinstance(m, StateSample)]
    assert [row[0] for row in states[0].rows["radar"]] == [20.0, 30.5]
    assert states[1].rows == {}, "none was due"


def test_a_grid_is_a_picture_for_those_who_look_and_in_no_recording(hub, clock):
    sections = {"radar": {}, "radar_cube": {"hz": 20}}
    campaign, mistakes = parse_campaign(
        {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}, "sensors": sections}
    )
    assert campaign is not None, mistakes
    recorder, listener = Listener(hub, recorder=True), Listener(hub, [ALONE])
    view = ViewPublisher(hub.open(), RIG, ViewMode.record_live)
    sim = Sim()
    cube = np.zeros((2, 400, 160, 32), np.float32)
    cube[0, 100, 40, 7] = 1e5
    sim.more["radar_cube"] = SensorData(cube)
    sim.begin(view, msgspec.structs.replace(lease(), case=expand(campaign)[0]))
    for late_s in (0.0, 0.2, 0.4):
        clock.now_s += late_s
        sim.step(view)
    sim.end(view)
    view.close(10)
    got = listener.wait()
    assert next(m for m in got if isinstance(m, CaseStart)).grids == ["radar_cube"]
    shown = [m for m in got if isinstance(m, CameraSample) and m.tick in (0, 2)]
    assert len(shown) == 4, "camera and cube at two ticks; half a second lies between two cubes"
    picture = cv2.imdecode(np.frombuffer(listener.payloads["radar_cube"], np.uint8), 1)
    assert picture.shape == (400, 320, 3)
    bright = np.unravel_index(picture[..., 0].argmax(), picture.shape[:2])
    assert (bright[0], bright[1] // 2) == (399 - 100, 40), "ranges upwards, speeds to the right"
    assert picture[..., 0].max() > 240
    start, *rest = recorder.wait()
    assert start.grids == []
    assert len([m for m in rest if isinstance(m, CameraSample)]) == 3, "the camera's alone"


def test_the_start_is_repeated_for_those_who_come_later(hub, clock):
    first = Listener(hub, [ALONE])
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    wait_for(lambda: any(isinstance(m, StateSample) for m in first.got), "a state")
    second = Listener(hub, ["view/c/clear/live/start"])
    for _ in range(3):
        clock.now_s += 0.6
        sim.step(view)
    view.close(10)
    first.wait()
    assert len(second.wait()) == 1


def test_others_are_not_shown(hub, clock):
    listener = Listener(hub, ["view/c/foggy/live/*"])
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    sim.end(view)
    view.close(10)
    assert listener.wait() == []


def test_eight_cases_of_a_rig_at_most(hub, clock):
    Listener(hub, ["view/*/*/live/*"])
    demand = Demand(hub.open(), ViewMode.live)
    runs = [SlotRun(lease(token), recorded=False) for token in range(9)]

    def shown(run):
        return bool(demand.due(run, ["camera"], clock.now_s, wall=False, singles=True))

    assert [shown(run) for run in runs] == [True] * 8 + [False]
    assert demand.ended(runs[3])
    assert shown(runs[8])


def test_one_picture_is_compressed_once_for_recorder_and_viewers(hub, clock, monkeypatch):
    made = []
    real = view_encoder.jpeg
    monkeypatch.setattr(view_encoder, "jpeg", lambda *a, **k: made.append(a) or real(*a, **k))
    listener = Listener(hub, ["view/*/*/thumbnail", ALONE], recorder=True)
    view = ViewPublisher(hub.open(), RIG, ViewMode.record_live)
    sim = Sim()
    sim.begin(view, lease())
    sim.step(view)
    view.close(10)
    pictures = [m for m in listener.wait() if isinstance(m, CameraSample)]
    assert {m.seq for m in pictures} == {1, UNNUMBERED}
    assert [a[1:] for a in made] == [(), (THUMBNAIL_WIDTH_PX,)], "and a small one for the wall"


def test_viewers_leave_no_gap_in_a_recording(hub, clock):
    """The same numbers, whoever looks beside the recorder."""
    recorder = Listener(hub, recorder=True)
    viewer = Listener(hub, [ALONE])
    view = ViewPublisher(hub.open(), RIG, ViewMode.record_live)
    sim = Sim()
    sim.begin(view, lease())
    for _ in range(3):
        sim.step(view)
    sim.end(view)
    view.close(10)
    assert [m.seq for m in recorder.wait()] == list(range(9))
    assert len(viewer.wait()) >= 4


def test_the_scene_is_handed_out_on_request(hub):
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    bus = hub.open()
    key = topics.FEED_SCENE.key.format(rig=RIG)
    sim.begin(view, lease())
    scene = decode(bus.request(key, b"", 10.0), SceneMesh)
    data = zlib.decompress(scene.data)
    assert hashlib.sha256(data).hexdigest() == scene.sha256
    assert (scene.faces, scene.vertices) == (10, 20)
    assert len(data) == 20 * 12 + 10 * 12 + 20 * 3
    points = np.frombuffer(data, "<f4", 60).reshape(-1, 3)
    faces = np.frombuffer(data, "<u4", 30, 240).reshape(-1, 3)
    colors = np.frombuffer(data, np.uint8, 60, 360).reshape(-1, 3)
    for face in faces:
        color = {tuple(colors[corner]) for corner in face}
        assert len(color) == 1, "one colour per face"
        red, green, _ = map(int, color.pop())
        assert (green > red) == bool((points[face][:, 2] == 1.0).all()), "only the lid is green"
    view.close(10)


def test_a_thumbnail_says_when_it_was_by_a_clock_that_viewers_may_read(hub, clock):
    listener = Listener(hub, ["view/*/*/thumbnail"])
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim, bus = Sim(), hub.open()
    (answer,) = bus.gather(topics.FEED_CLOCK.key.format(rig="*"), b"", 10.0)
    assert decode(answer, ClockReading) == ClockReading(v=1, rig=RIG, clock_s=100.0)
    sim.begin(view, lease())
    for _ in range(2):
        sim.step(view)
        clock.now_s += 0.5
    sim.end(view)
    view.close(10)
    got = [m for m in listener.wait() if isinstance(m, Thumbnail)]
    assert [(m.rig, m.at_s, m.outcome) for m in got] == [
        (RIG, 100.0, ""),
        (RIG, 100.5, ""),
        (RIG, 101.0, "verdict"),
    ]


def test_a_case_without_cameras_is_on_the_wall_and_in_full(hub, clock):
    """``render: off``: no pictures, and states as often as with them."""
    listener = Listener(hub, ["view/*/*/thumbnail", ALONE])
    view = ViewPublisher(hub.open(), RIG, ViewMode.live)
    sim = Sim()
    sim.sensed = dict
    blind = lease()
    blind = msgspec.structs.replace(blind, case=changed(blind.case, render=False))
    sim.begin(view, blind)
    for _ in range(4):
        sim.step(view)
        clock.now_s += 0.06
    sim.end(view)
    view.close(10)
    got = listener.wait()
    assert [m.tick for m in got if isinstance(m, StateSample)] == [0, 2, 4]
    assert [m.outcome for m in got if isinstance(m, Thumbnail)] == ["", "verdict"]
    assert listener.payloads["thumbnail"] == b""
