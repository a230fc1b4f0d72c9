"""Messages of the view plane for tests."""

from schemas import SCHEMA_VERSION
from schemas.messages import Detection, Lights
from schemas.wire.view import (
    CameraSample,
    CaseEnd,
    CaseStart,
    Controls,
    ImageBox,
    Stage,
    StateSample,
    Thumbnail,
)

STAGE = Stage(
    lane=[[-60.0, 0.0, 0.0], [345.0, 0.0, 0.0]],
    lane_width_m=3.5,
    parking_width_m=2.3,
    sidewalk_width_m=4.2,
    obstacle_center_m=[234.25, 0.0, 0.73],
    obstacle_yaw_rad=0.0,
    obstacle_size_m=[4.5, 1.8, 1.46],
    ego_center_m=[1.47, 0.0, 0.75],
    ego_size_m=[4.98, 1.95, 1.5],
    camera_m=[2.05, -0.35, 1.32],
    hulls=[[10.0, -2.9, 0.0, 2.25, 0.9], [20.0, -12.0, 0.0, 8.0, 7.0], [5.0, 6.0, 0.0, 0.1, 0.1]],
    cars=1,
)


def start(folder="/nowhere", seq=0, token=7, **changes):
    """The beginning of an attempt."""
    values = {
        "campaign": "demo",
        "case": "clear-1",
        "attempt": 1,
        "model": "yolov3",
        "weather": "heavy_fog",
        "time_of_day_min": 300,
        "stage": STAGE,
        **changes,
    }
    return CaseStart(
        v=SCHEMA_VERSION,
        seq=seq,
        token=token,
        folder=str(folder),
        scene="downtown",
        vehicle="opencav",
        seed=1,
        control_hz=20,
        camera="front_right",
        width=64,
        height=36,
        hfov_deg=70.0,
        **values,
    )


def controls(aeb=False, detections=(), trigger=None):
    """A command."""
    return Controls(0.0, 1.0 if aeb else 0.0, 0.0, aeb, Lights(), list(detections), trigger)


def detection(width_px=20.0):
    """One detected car."""
    return Detection("car", 0.9, 10.0, 10.0, width_px, 8.0)


def state(seq, tick=0, token=7, **changes):
    """One KPI row."""
    values = {
        "x_m": 200.0,
        "y_m": 0.0,
        "yaw_rad": 0.0,
        "speed_mps": 9.0,
        "accel_mps2": 0.0,
        "dtc_m": 20.0 - tick,
        "ttc_s": 2.0,
        "collisions": 0,
        "controls": controls(),
        "boxes": [ImageBox("car", 10.0, 10.0, 20.0, 8.0, 21.0)],
        **changes,
    }
    time_ns = tick * 50_000_000
    return StateSample(
        v=SCHEMA_VERSION, seq=seq, token=token, tick=tick, sim_time_ns=time_ns, **values
    )


def camera(seq, tick=0, token=7):
    """Attachment of a picture."""
    return CameraSample(
        v=SCHEMA_VERSION, seq=seq, token=token, tick=tick, sim_time_ns=tick * 50_000_000
    )


def end(seq, token=7, tick=3, **changes):
    """The end of an attempt."""
    values = {
        "outcome": "verdict",
        "verdict": "pass",
        "reasons": ["came to rest 3.00 m from the obstacle"],
        "scalars": {"dtc_min_m": 3.0, "aeb_time_s": None},
        **changes,
    }
    return CaseEnd(
        v=SCHEMA_VERSION,
        seq=seq,
        token=token,
        sim_time_ns=tick * 50_000_000,
        samples=seq + 1,
        **values,
    )


def thumbnail(case="clear-1", v=SCHEMA_VERSION, **changes):
    """Attachment of a thumbnail."""
    values = {
        "token": 7,
        "sim_time_ns": 1_000_000_000,
        "speed_mps": 9.0,
        "dtc_m": 20.0,
        "aeb": False,
        **changes,
    }
    return Thumbnail(
        v=v,
        seq=0,
        campaign="demo",
        case=case,
        attempt=1,
        model="yolov3",
        weather="clear",
        time_of_day_min=780,
        **values,
    )
