"""One case in full: which messages reach its recording."""

import hashlib
import zlib

import msgspec
import numpy as np
import pytest
import rerun as rr
from view_messages import camera, end, start, state

from schemas import SCHEMA_VERSION
from schemas.messages import CameraSite, LidarSite
from schemas.sections.lens import Lens
from schemas.wire.codec import WireError, encode
from schemas.wire.view import PointsSample, SceneMesh
from twin.fabric.bus import Sample
from viewer.live.focus import FocusedCase, Scenes
from viewer.recording import naming
from viewer.recording.scenery import points, rotation, unpacked

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
FACES = np.array([[0, 1, 2]], "<u4")
COLORS = np.array([[9, 8, 7]] * 3, np.uint8)


def scene(faces=FACES, **changes):
    data = POINTS.tobytes() + faces.tobytes() + COLORS.tobytes()
    values = {
        "sha256": hashlib.sha256(data).hexdigest(),
        "vertices": 3,
        "faces": 1,
        "data": zlib.compress(data),
        **changes,
    }
    return SceneMesh(v=SCHEMA_VERSION, **values)


class Stream:
    """A recording that remembers what it was told."""

    def __init__(self):
        self.logged = []
        self.times = []
        self.open = True
        self.stuck = False

    def log(self, path, archetype, static):
        self.logged.append((path, type(archetype).__name__, static))

    def send_columns(self, path, indexes, columns):
        [times, _ticks] = indexes
        self.times += times.as_arrow_array().to_pylist()
        [kind] = {column.component_descriptor().component.partition(":")[0] for column in columns}
        self.logged.append((path, kind, False))

    def flush(self, timeout_sec):
        if self.stuck:
            raise RuntimeError("timeout")

    def disconnect(self):
        assert not self.stuck, "that would wait for the viewer"
        self.open = False

    def paths(self):
        return {path for path, _, _ in self.logged}


class Seat:
    """Somebody who looks at one case."""

    def __init__(self):
        self.streams = []
        self.asked = []
        self.scenes = Scenes(lambda rig, sha256: self.asked.append((rig, sha256)))
        self.focus = FocusedCase(self.open, self.scenes)

    def open(self, _start):
        self.streams.append(Stream())
        return self.streams[-1]

    def send(self, stream, message, payload=None):
        data = encode(message)
        sample = Sample(f"view/demo/clear-1/live/{stream}", data, b"")
        if payload is not None:
            sample = Sample(sample.key, payload, data)
        self.focus.take(sample)


def begin(**changes):
    return msgspec.structs.replace(start(seq=-1), rig="r", scene_sha256="s", **changes)


def test_what_comes_before_the_start_is_not_shown():
    seat = Seat()
    seat.send("state", state(-1))
    seat.send("camera", camera(-1), b"jpeg")
    assert seat.streams == []
    seat.send("start", begin())
    seat.send("state", state(-1))
    seat.send("camera", camera(-1), b"jpeg")
    seat.send("camera.front_left", camera(-1), b"jpeg")
    shown = seat.streams[0]
    assert {naming.SPEED, naming.CAMERA, "world/ego/camera_front_left"} <= shown.paths()
    assert naming.STREET not in shown.paths(), "it comes as a mesh"


def test_a_grid_is_a_picture_that_no_camera_sees():
    seat = Seat()
    seat.send("start", begin(grids=["radar_cube", "state"]))
    seat.send("radar_cube", camera(-1), b"jpeg")
    seat.send("other_grid", camera(-1), b"jpeg")
    seat.send("state", state(-1))
    shown = seat.streams[0]
    assert (naming.grid("radar_cube"), "EncodedImage", False) in shown.logged
    assert naming.SPEED in shown.paths(), "no grid takes the place of another stream"
    assert not {path for path in shown.paths() if "other_grid" in path}


def test_the_start_is_repeated_and_shown_once():
    seat = Seat()
    seat.send("start", begin())
    seat.send("start", begin())
    assert len(seat.streams) == 1
    seat.send("start", begin(token=8, attempt=2))
    assert [s.open for s in seat.streams] == [False, True]
    seat.send("state", state(-1, token=7))
    assert naming.SPEED not in {p for p, _, static in seat.streams[1].logged if not static}


def test_of_two_attempts_at_once_the_later_is_shown():
    seat = Seat()
    for token in (7, 8, 7, 8, 7):
        seat.send("start", begin(token=token))
    assert [s.open for s in seat.streams] == [False, True]
    seat.send("state", state(-1, token=8))
    assert naming.SPEED in {p for p, _, static in seat.streams[1].logged if not static}
    seat.focus.forget()
    seat.send("start", begin(token=1))
    assert len(seat.streams) == 3, "the campaign was begun anew"


def test_a_recording_of_a_frozen_viewer_is_left_as_it_is(monkeypatch):
    kept = []
    monkeypatch.setattr("viewer.live.hub.STUCK", kept)
    seat = Seat()
    seat.send("start", begin())
    seat.streams[0].stuck = True
    seat.focus.close()
    assert kept == seat.streams


def test_a_world_is_sent_for_once_and_shown_to_all():
    seat = Seat()
    good = scene()
    seat.send("start", begin())
    seat.send("start", begin())
    assert seat.asked == [("r", "s")]
    seat.scenes.came("s", None)
    seat.send("start", begin())
    assert seat.asked == [("r", "s")] * 2, "nobody had answered"
    assert "changed meanwhile" in seat.scenes.came("s", good)
    seat.focus.stand()
    assert naming.STREET in seat.streams[0].paths(), "its outlines instead"
    seat.send("start", msgspec.structs.replace(begin(token=9), scene_sha256=good.sha256))
    assert seat.asked[-1] == ("r", good.sha256)
    assert seat.scenes.came(good.sha256, good) == ""
    seat.focus.stand()
    assert (naming.SCENE, "Mesh3D", True) in seat.streams[1].logged
    seat.send("start", msgspec.structs.replace(begin(token=10), scene_sha256=good.sha256))
    assert len(seat.asked) == 3, "it is here already"
    assert (naming.SCENE, "Mesh3D", True) in seat.streams[2].logged


def test_the_verdict_arrives():
    seat = Seat()
    seat.send("start", begin())
    seat.send("end", end(-1))
    assert (naming.SUMMARY, "TextDocument", True) in seat.streams[0].logged[-1:]
    assert naming.EVENTS in seat.streams[0].paths()
    seat.send("end", end(-1, token=99))
    assert len([p for p, _, _ in seat.streams[0].logged if p == naming.EVENTS]) == 1


def test_another_version_is_refused():
    seat = Seat()
    with pytest.raises(WireError, match="install the same version"):
        seat.send("start", msgspec.structs.replace(begin(), v=SCHEMA_VERSION + 1))


def test_points_are_in_metres():
    rows = np.array([[150, -200, 30, 0], [0, 0, 0, 255]], "<i2")
    [positions, _colors] = points(rows.tobytes())
    [xyz] = positions.as_arrow_array().to_pylist()
    assert np.allclose(xyz, [[1.5, -2.0, 0.3], [0, 0, 0]])
    with pytest.raises(ValueError, match=r"reshape|multiple"):
        points(b"123")
    seat = Seat()
    seat.send("start", begin())
    sample = PointsSample(v=SCHEMA_VERSION, token=7, tick=1, sim_time_ns=0, stride=2)
    seat.send("lidar.roof", sample, rows.tobytes())
    assert ("world/ego/lidar_roof", "Points3D", False) in seat.streams[0].logged


def test_a_damaged_world_is_refused():
    assert isinstance(unpacked(scene()), rr.Mesh3D)
    for wrong, words in (
        (scene(data=b"nonsense"), "damaged"),
        (scene(data=zlib.compress(b"short")), "another digest"),
        (scene(sha256="0"), "another digest"),
        (scene(faces=np.array([[0, 1, 3]], "<u4")), "without a corner"),
        (scene(vertices=10**9), "too large"),
        (scene(vertices=-1), r"damaged|too large"),
    ):
        with pytest.raises(ValueError, match=words):
            unpacked(wrong)


def test_a_bomb_is_not_unpacked():
    bomb = scene(data=zlib.compress(bytes(64 << 20)))
    with pytest.raises(ValueError, match="another digest"):
        unpacked(bomb)


def test_rotations_are_those_of_the_mounts():
    """Positive pitch looks down, positive yaw to the left."""
    forward = np.array([1.0, 0.0, 0.0])
    assert np.allclose(rotation([0, 90, 0]) @ forward, [0, 0, -1])
    assert np.allclose(rotation([0, 0, 90]) @ forward, [0, 1, 0])
    assert np.allclose(rotation([90, 0, 0]) @ [0, 1, 0], [0, 0, 1])
    assert np.allclose(rotation([0, 30, 90]) @ forward, [0, np.cos(np.pi / 6), -0.5])


def test_all_eyes_of_the_ego_have_their_places():
    site = {"position_m": [1.0, 0.5, 1.3], "rotation_deg": [0.0, 0.0, 20.0]}
    cameras = [
        CameraSite(
            name=n, message=m, width=64, height=36, hz=10, hfov_deg=70.0, lens=Lens(), **site
        )
        for n, m in (("front_right", "camera"), ("front_left", "camera.front_left"))
    ]
    lidar = LidarSite(
        name="roof", message="lidar.roof", hz=10, channels=4, columns=8, fields=[], **site
    )
    seat = Seat()
    seat.send("start", begin(cameras=cameras, lidars=[lidar]))
    logged = seat.streams[0].logged
    for path in (naming.CAMERA, "world/ego/camera_front_left"):
        assert {(path, "Transform3D", True), (path, "Pinhole", True)} <= set(logged)
    assert ("world/ego/lidar_roof", "Transform3D", True) in logged
