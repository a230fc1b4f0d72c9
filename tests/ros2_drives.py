"""An attempt's folder with a drive's record and a recording, for exports to ROS 2."""

from __future__ import annotations

import math
from pathlib import Path

from ros2_messages import car_tick, episode
from view_messages import controls, end, start, state

from schemas import SCHEMA_VERSION
from schemas.files.drive_record import RecordAnswer, RecordHead, RecordSeen
from schemas.messages import Command, Detection
from schemas.plan import parse_plan
from twin.records.drive_record import RecordWriter, coded
from viewer.recording.recording import RecordingFile

TICKS = 6
PERIOD_NS = 50_000_000


def command(tick: int) -> Command:
    """The stack's answer to a tick."""
    seen = [Detection("car", 0.5, 1.0, 2.0, 3.0, 4.0)] if tick % 2 else []
    return Command(0, 7, tick, 0.1 * tick, 0.0, -0.01 * tick, detections=seen)


def ego_pose(tick: int) -> tuple[float, float, float]:
    """x, y and heading of the ego."""
    return 200.0 + 0.5 * tick, -1.75 + 0.01 * tick, 0.002 * tick


def mover(tick: int, number: int) -> list[float]:
    """A row of ``StateSample.movers``: the first is a car, the second somebody on foot."""
    if number == 0:
        return [230.0 + 0.4 * tick, 1.75, 0.0, math.pi, 2.25, 0.9, 1.46]
    # At last it is where the car has just been: nearer to that than to its own place before.
    return [231.6, 1.28 + 0.1 * tick, 0.0, 0.5 * math.pi, 0.3, 0.3, 1.8]


def movers(tick: int) -> list[list[float]]:
    """Objects that move; the second is there from the third tick on, the first until the fifth."""
    there = [number for number in range(2) if (tick < 5, tick >= 2)[number]]
    return [mover(tick, number) for number in there]


def write_attempt(folder: Path, *, record: bool = True, recording: bool = True) -> Path:
    """A campaign's folder with one case, ``clear``; the folder of its attempt."""
    attempt = folder / "cases/clear/attempt-1"
    attempt.mkdir(parents=True)
    if record:
        _record(attempt)
    if recording:
        _recording(attempt)
    return attempt


def _record(attempt: Path) -> None:
    plan, mistakes = parse_plan({"campaign": "c", "matrix": {"weather": ["clear"]}})
    assert plan is not None, mistakes
    head = RecordHead(SCHEMA_VERSION, 1, "", "cpu", 1, plan.cases[0])
    writer = RecordWriter(attempt / "drive.record", head)
    for tick in range(TICKS):
        car = car_tick(tick)
        sensors = {
            name: coded(values, car.counts.get(name, -1)) for name, values in car.sensors.items()
        }
        told = episode() if tick == 0 else None
        writer.write(RecordSeen(tick, PERIOD_NS * tick, sensors, told))
        writer.write(RecordAnswer(command(tick)))
    writer.end("verdict", "pass", "")


def _recording(attempt: Path) -> None:
    file = RecordingFile(start(attempt))
    for tick in range(TICKS):
        x_m, y_m, yaw_rad = ego_pose(tick)
        file.state(
            state(
                tick + 1,
                tick,
                controls=controls(),
                boxes=None,
                x_m=x_m,
                y_m=y_m,
                z_m=0.25,
                yaw_rad=yaw_rad,
                speed_mps=10.0,
                movers=movers(tick),
            )
        )
    file.close(end(TICKS + 1, tick=TICKS))
