"""devkit.fusion in a closed loop: what rulebooks ask for, with other numbers, and what nobody
should brake for."""

from __future__ import annotations

import math
from typing import Any

from fused_loop import FRONT_M, Mover, Situation, drive_all

KMH = 1.0 / 3.6


def person(**values: Any) -> Mover:
    size = {"length_m": 0.5, "width_m": 0.5, "height_m": 1.75}
    return Mover(label="pedestrian", rcs_dbsm=-8.0, wheels=False, **{**size, **values})


def cyclist(**values: Any) -> Mover:
    size = {"length_m": 1.8, "width_m": 0.6, "height_m": 1.7}
    return Mover(label="bicycle", rcs_dbsm=-3.0, wheels=False, **{**size, **values})


def motorcycle(**values: Any) -> Mover:
    size = {"length_m": 2.1, "width_m": 0.8, "height_m": 1.5}
    return Mover(label="bicycle", rcs_dbsm=3.0, **size, **values)


def crosses(kind: Any, speed_kmh: float, vy_mps: float, **values: Any) -> Situation:
    """Meets the ego's front after 5 s, having moved for 4.6 s."""
    speed = speed_kmh * KMH
    mover = kind(x_m=speed * 5.0 + FRONT_M, y_m=-4.6 * vy_mps, vy_mps=vy_mps, from_s=0.4, **values)
    return Situation(speed, [mover])


def ahead(kind: Any, speed_kmh: float, target_kmh: float, **values: Any) -> Situation:
    """Would be met after 5 s."""
    gap_m = (speed_kmh - target_kmh) * KMH * 5.0
    return Situation(
        speed_kmh * KMH, [kind(x_m=gap_m + FRONT_M, vx_mps=target_kmh * KMH, **values)]
    )


def brakes(kind: Any, speed_kmh: float, gap_m: float, **values: Any) -> Situation:
    speed = speed_kmh * KMH
    return Situation(speed, [kind(x_m=gap_m + FRONT_M, vx_mps=speed, brakes_s=2.5, **values)])


AVOIDED = {
    "standing car": ahead(Mover, 47, 0, y_m=0.9),
    "fast at a standing car": ahead(Mover, 68, 0),
    "slower car": ahead(Mover, 125, 70),
    "braking car": brakes(Mover, 76, 21.0),
    "fast behind a braking car": brakes(Mover, 125, 34.5, y_m=0.5),
    "standing motorcycle": ahead(motorcycle, 52, 0, y_m=-0.5),
    "braking motorcycle": brakes(motorcycle, 76, 21.0),
    "oncoming car": ahead(Mover, 75, -65),
    "adult from the right": crosses(person, 57, 1.45),
    "adult from the left": crosses(person, 57, -2.3),
    "slow, adult from the left": crosses(person, 15, -2.3),
    "adult along the lane": ahead(person, 57, 5, y_m=0.4),
    "cyclist along the lane": ahead(cyclist, 57, 16),
    "cyclist from the right": crosses(cyclist, 57, 4.2, length_m=0.6, width_m=1.8),
    "cyclist from the left": crosses(cyclist, 36, -5.4, length_m=0.6, width_m=1.8),
}
LEFT_ALONE = {
    "between parked cars": Situation(
        75 * KMH, [Mover(x_m=90.0, y_m=y) for y in (-2.75, 2.75)], 7.0
    ),
    "oncoming in its lane": Situation(60 * KMH, [Mover(x_m=200.0, y_m=3.5, vx_mps=-60 * KMH)], 7.0),
    "adult at the kerb": Situation(45 * KMH, [person(x_m=80.0, y_m=-2.6)], 8.0),
    "adult who stops": Situation(
        45 * KMH, [person(x_m=80.0, y_m=-7.0, vy_mps=1.4, from_s=1.0, until_s=4.0)], 8.0
    ),
    "leader drives away": Situation(60 * KMH, [Mover(x_m=25.0, vx_mps=65 * KMH)], 6.0),
    "slower in the next lanes": Situation(
        80 * KMH, [Mover(x_m=70.0, y_m=y, vx_mps=40 * KMH) for y in (-3.6, 3.6)], 6.0
    ),
    "guard rail where a curve begins": Situation(
        72 * KMH,
        [
            Mover(
                x_m=74.0 + 5.0 * n, y_m=3.2 - n * n / 20.0, width_m=0.3, length_m=5.0, height_m=0.8
            )
            for n in range(14)
        ],
        3.0,
    ),
}


def test_whom_it_has_to_stop_for_it_does_not_touch():
    cars = dict(zip(AVOIDED, drive_all(list(AVOIDED.values())), strict=True))
    # A car that stands may be met by one that comes along its lane and does not brake.
    touched = {name: car.impact_mps for name, car in cars.items() if car.impact_mps}
    assert touched == {}
    early = {name: car.braked_s for name, car in cars.items() if (car.braked_s or 0.0) < 1.0}
    assert early == {}, "it brakes before it can know"
    assert all((car.warned_s or math.inf) <= (car.braked_s or 0.0) for car in cars.values())


def test_whom_it_need_not_stop_for_it_leaves_alone():
    cars = dict(zip(LEFT_ALONE, drive_all(list(LEFT_ALONE.values())), strict=True))
    assert {name: car.braked_s for name, car in cars.items() if car.braked_s is not None} == {}
    assert {name for name, car in cars.items() if car.impact_mps is not None} == set()


def test_it_brakes_on_while_its_nose_dives():
    """All echoes look as if they came from 3 m above the road while the car brakes fully: what
    radar alone sees is braked for until the car stands."""
    comes = [ahead(Mover, 66, -68), ahead(Mover, 80, -60, y_m=0.4)]
    for car in drive_all(comes, sensors_used="camera+radar"):
        assert car.braked_s is not None
        assert car.released_s is None, "it lets go of the brake"
