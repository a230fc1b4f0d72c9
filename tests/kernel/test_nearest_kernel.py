"""Distance and time to collision over every hull, against plain geometry in NumPy."""

import numpy as np
import pytest
import warp as wp

from twin.vehicle.fleet import Fleet
from twin.vehicle.state import columns
from twin.vehicle.vehicle_file import load_vehicle

CAR = load_vehicle("opencav")
HULL = (CAR.length_m / 2, CAR.width_m / 2)


def fleet(walls=(), *, slots=1, movers=0):
    made = Fleet(
        [CAR],
        slots,
        wp.get_device("cpu"),
        colliders=np.array(walls, float).reshape(-1, 5),
        movers=movers,
    )
    for slot in range(slots):
        made.place(slot, 0.0, 0.0, 0.9, refresh=False)
        made.active[slot] = 1
    made.refresh()
    return made


def at(made, slot, x_m, y_m, yaw_rad, velocity):
    """Put the middle of the hull somewhere, with a velocity."""
    back = CAR.centre_offset_m
    x, y = x_m - back * np.cos(yaw_rad), y_m - back * np.sin(yaw_rad)
    made.place(slot, x, 0.0, 0.9, y_m=y, yaw_rad=yaw_rad)
    made.state[slot, 0, columns("velocity")] = (*velocity, 0.0)
    made._state.push()


def corners(box):
    x, y, yaw, length, width = box[:5]
    along, across = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]).T * [[length], [width]]
    return np.stack(
        [
            x + along * np.cos(yaw) - across * np.sin(yaw),
            y + along * np.sin(yaw) + across * np.cos(yaw),
        ],
        axis=1,
    )


def distance(a, b):
    """Of two boxes, from points on their edges to the segments of the other."""
    best = np.inf
    for one, other in ((corners(a), corners(b)), (corners(b), corners(a))):
        for p, q in zip(other, np.roll(other, -1, axis=0), strict=True):
            t = np.clip(((one - p) @ (q - p)) / ((q - p) @ (q - p)), 0.0, 1.0)
            best = min(best, np.hypot(*(p + t[:, None] * (q - p) - one).T).min())
    return 0.0 if overlap(a, b) else best


def overlap(a, b):
    one, other = corners(a), corners(b)
    for yaw in (a[2], b[2]):
        for axis in ((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))):
            s, t = one @ axis, other @ axis
            if s.max() < t.min() or t.max() < s.min():
                return False
    return True


def first_touch(a, b, velocity, until_s=6.0, step_s=0.002):
    """The first of many moments at which they overlap; None: never."""
    times = np.arange(0.0, until_s, step_s)
    touching = np.ones(len(times), bool)
    one, other = corners(a), corners(b)
    for yaw in (a[2], b[2]):
        for axis in ((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))):
            way = times * (np.array(axis) @ velocity)
            s, t = one @ axis, other @ axis
            touching &= (s.max() + way >= t.min()) & (t.max() >= s.min() + way)
    return float(times[np.argmax(touching)]) if touching.any() else None


def surveyed(fleet):
    fleet.survey(fleet.movers)
    return fleet.nearest()


def test_distances_and_times_are_those_of_geometry():
    draw = np.random.default_rng(3)
    met = missed = 0
    for _ in range(60):
        walls = np.column_stack(
            [
                draw.uniform(-20, 20, 4),
                draw.uniform(-20, 20, 4),
                draw.uniform(-3.1, 3.1, 4),
                draw.uniform(0.2, 3.0, 4),
                draw.uniform(0.2, 1.5, 4),
            ]
        )
        yaw, velocity = draw.uniform(-3.1, 3.1), draw.uniform(-8.0, 8.0, 2)
        made = fleet(walls)
        at(made, 0, 0.0, 0.0, yaw, velocity)
        (found,) = surveyed(made)
        ego = (0.0, 0.0, yaw, *HULL)
        distances = [distance(ego, wall) for wall in walls]
        assert found[0] == pytest.approx(min(distances), abs=1e-9)
        if min(distances) > 0.0:
            assert found[1] == np.argmin(distances)
        times = [first_touch(ego, wall, velocity) for wall in walls]
        known = [time for time in times if time is not None]
        if not known:
            missed += 1
            assert found[3] == -1 or found[2] > 5.9
            continue
        met += 1
        assert found[2] == pytest.approx(min(known), abs=0.0021)
        if sum(time < min(known) + 0.003 for time in known) == 1:
            assert times[int(found[3])] == min(known)
    assert met > 15
    assert missed > 5


def test_a_hull_beside_the_way_is_near_and_never_hit():
    made = fleet([(10.0, 3.0, 0.0, 2.0, 0.9)])
    at(made, 0, 0.0, 0.0, 0.0, (8.0, 0.0))
    (found,) = surveyed(made)
    assert found[1] == 0
    assert found[3] == -1


def test_movers_come_after_walls():
    """Each is the nearest in a slot of its own; those that are not there do not count."""
    made = fleet([(50.0, 0.0, 0.0, 1.0, 1.0)], slots=3, movers=2)
    for slot in range(3):
        at(made, slot, 0.0, 0.0, 0.0, (5.0, 0.0))
    made.movers[1, 1] = (20.0, 0.0, 0.0, 0.3, 0.3, -2.0, 0.0, 0.0)
    made.movers[2, 0] = (20.0, 0.0, 0.0, 0.0, 0.3, -2.0, 0.0, 0.0)
    found = surveyed(made)
    assert found[:, 1].tolist() == [0, 2, 0]
    assert found[:, 3].tolist() == [0, 2, 0]
    gap = 20.0 - 0.3 - HULL[0]
    assert found[1, 0] == pytest.approx(gap)
    assert found[1, 2] == pytest.approx(gap / 7.0)


def test_nothing_depends_on_the_slot_and_inactive_ones_have_nothing():
    walls = [(12.0, 1.0, 0.3, 2.0, 0.9), (-8.0, 0.5, 0.0, 1.0, 1.0)]
    made = fleet(walls, slots=3)
    for slot in (0, 2):
        at(made, slot, 0.0, 0.0, 0.1, (7.0, 0.4))
    made.active[1] = 0
    found = surveyed(made).copy()
    assert found[0].tobytes() == found[2].tobytes()
    assert (found[1, [1, 3]] == -1).all()
    alone = fleet(walls)
    at(alone, 0, 0.0, 0.0, 0.1, (7.0, 0.4))
    assert surveyed(alone)[0].tobytes() == found[0].tobytes()


def test_what_was_hit_first_is_told_by_the_same_count():
    made = fleet([(80.0, 0.0, 0.0, 1.0, 1.0)], movers=2)
    made.movers[0, 0] = (30.0, 0.0, 0.0, 0.3, 0.3, 0.0, 0.0, 0.0)
    made.movers[0, 1] = (12.0, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0)
    assert made.first_hit(0) == -1
    made.place(0, 0.0, 10.0, 0.9)
    while not made.event_count[0]:
        made.advance(25)
        made.first_step[0] += 25
    assert made.first_hit(0) == 2  # one wall, one mover, then this one
