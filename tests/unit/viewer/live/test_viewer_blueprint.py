"""Every layout that is shipped, rendered by the native viewer: it complains of nothing."""

import cv2
import msgspec
import numpy as np
import pytest
import rerun as rr
from unit.viewer.recorded_case import PICTURES, write
from view_messages import STAGE, camera, controls, detection, end, start, state, thumbnail

from schemas import SCHEMA_VERSION
from schemas.files.kpi import SCALARS
from schemas.messages import CameraSite, LidarSite
from schemas.sections.lens import Lens
from schemas.wire.codec import encode
from schemas.wire.view import PointsSample
from twin.base.gpu.vulkan import has_vulkan
from twin.fabric.bus import Sample
from viewer.live.focus import FocusedCase, Scenes
from viewer.live.hub import ViewerHub
from viewer.live.overview import Overview
from viewer.live.pulse import Pulse
from viewer.playback.folder import RecordedMoment
from viewer.playback.shot import shoot
from viewer.recording import naming
from viewer.recording.blueprint import case_blueprint, overview_blueprint

pytestmark = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)

SITE = {"position_m": [2.0, 0.0, 1.3], "rotation_deg": [0.0, 0.0, 0.0], "hz": 10}
CAMERAS = [
    CameraSite(name=n, message=m, width=64, height=36, hfov_deg=70.0, lens=Lens(), **SITE)
    for n, m in (("front_right", "camera"), ("front_left", "camera.front_left"))
]
LIDARS = [LidarSite(name="roof", message="lidar.roof", channels=1, columns=10, fields=[], **SITE)]


def written(path, app, blueprint):
    stream = rr.RecordingStream(app, recording_id=path.stem)
    stream.set_sinks(rr.FileSink(path), default_blueprint=blueprint)
    return stream


def a_case_in_full(path):
    """Two cameras, a lidar, something that moves."""
    layout = case_blueprint(STAGE, CAMERAS, LIDARS, live=True)
    stream = written(path, f"{naming.CASE_APP}_live", layout)
    focus = FocusedCase(lambda _: stream, Scenes(lambda *_: None))
    begin = msgspec.structs.replace(start(seq=-1), cameras=CAMERAS, lidars=LIDARS, rig="r")

    def take(name, message, payload=None):
        data = encode(message)
        key = f"view/demo/clear-1/live/{name}"
        focus.take(Sample(key, data, b"") if payload is None else Sample(key, payload, data))

    take("start", begin)
    points = np.array([[1000, 100 * i, 10, 20 * i] for i in range(10)], "<i2")
    for tick in range(3):
        for name in ("camera", "camera.front_left"):
            take(name, camera(-1, tick), PICTURES[tick])
        moving = [[220.0, 2.0, 0.0, 0.1, 0.3, 0.3, 1.7]]
        seen = controls(tick == 2, [detection()])
        take("state", state(-1, tick, controls=seen, movers=moving))
        sweep = PointsSample(
            v=SCHEMA_VERSION, token=7, tick=tick, sim_time_ns=tick * 50_000_000, stride=1
        )
        take("lidar.roof", sweep, points.tobytes())
    take("end", end(-1))
    focus.close()


def the_wall(path):
    stream = written(path, naming.OVERVIEW_APP, overview_blueprint())
    hub, overview, pulse = ViewerHub(stream, ""), Overview(), Pulse()
    for index in range(5):
        overview.take(thumbnail(f"c{index}"), PICTURES[index % 3])
    for second in range(3):
        workers = [{"id": "w1", "present": True, "held": 2}]
        pulse.status(
            {"campaigns": {"demo": {"cases": 9, "left": 5, "leased": 2}}, "workers": workers},
            second,
        )
        hub.tell(pulse, float(second))
        hub.show(overview, float(second))
    hub.close()


def test_every_layout_is_rendered_without_a_warning(tmp_path):
    from viewer.playback.window import window

    recorded = write(tmp_path / "attempt")
    live, wall = tmp_path / "live.rrd", tmp_path / "wall.rrd"
    a_case_in_full(live)
    the_wall(wall)
    layouts = {
        "demo-clear-1-1": {"Camera, detections, truth (thin)", "Street", "Planner", "Case"},
        "live": {"Street, lidar", "front_left", "Events", "Speed [m/s]"},
        "wall": {"Cases", "Running and latest", "Cases per worker"},
    }
    files = [str(path) for path in (recorded, live, wall)]
    with window(["--window-size", "800x450", *files], headless=True) as shown:
        recordings = shown.loaded(3).recordings
        for name, views in layouts.items():
            [found] = [r for r in recordings if r.store_id.endswith(f":{name}")]
            shown.client.set_location(found.location)
            (tmp_path / f"{name}.png").write_bytes(shown.client.take_screenshot())
            state = shown.client.get_state()
            assert views <= {view.name for view in state.views}
            assert [report for view in state.views for report in view.reports] == [], name
        logs = [entry for entry in shown.client.get_logs() if "WARN" in str(entry).upper()]
        assert logs == []


LONG = (
    "collision with pedestrian walker-3 at 6.31 m/s, while the obstacle was 55.25 m away; its "
    "nearest point was the left edge of the bonnet"
)
CASE_END = (slice(238, 254), slice(756, 1270))
"""Rows and columns [px] of the panel Case, just above its lower edge."""


@pytest.mark.parametrize(("reasons", "fits"), [([LONG], True), ([LONG] * 4, False)])
def test_the_case_panel_shows_its_last_row(tmp_path, monkeypatch, reasons, fits):
    scalars = {column.name: 12.34 for column in SCALARS}
    closing = {"reasons": reasons, "scalars": scalars, "verdict": "collision", "passed": False}
    closed = "unit.viewer.recorded_case.end"
    monkeypatch.setattr(closed, lambda seq, tick: end(seq, tick=tick, **closing))
    names = {"case": "yolov2-tiny-w25-1300-heavy_rain-60", "campaign": "latency-study"}
    out = tmp_path / "shot.png"
    shoot(write(tmp_path, **names), RecordedMoment(0, "start"), out, (1280, 720))
    shades = cv2.imread(str(out))[CASE_END].reshape(-1, 3)
    assert (len(np.unique(shades, axis=0)) == 1) is fits, "text is cut where the panel ends"
