"""Lamps of vehicles and of traffic lights that are switched one by one."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import Script, camera_in, flat, light_slot, mesh_of, quad, world_of

from schemas.messages import Lights
from twin.actors.lamps import VehicleLamp
from twin.actors.palette import build_palette
from twin.world.meshes import materials

ROAD = quad((-50, -300, -1.4), (600, -300, -1.4), (600, 300, -1.4), (-50, 300, -1.4))
NIGHT = {"weather": "clear", "minute": 0, "lights": Lights()}
NOON = {"weather": "clear", "minute": 720, "lights": Lights()}
pytestmark = pytest.mark.slow
NIGHT_AND_NOON = pytest.mark.parametrize("when", [NIGHT, NOON], ids=["night", "noon"])


def bits(*lamps):
    return sum(1 << lamp for lamp in lamps)


def of_palette(sort):
    """The first body of a sort as cases have it."""
    palette = build_palette()
    look = next(look for look in palette.looks if look.sort == sort)
    return palette.kinds[look.kind]


def shoot(kind, when, lights=0, yaw=0.0, x=9.0, lamps=1.0):
    """A picture of a body ahead, and where the body is on it."""
    script = Script(
        position_m=np.array([[x, 0.0, -1.4]]),
        yaw_rad=np.array([yaw]),
        lamps=np.array([lamps], np.float32),
        lights=np.array([lights], np.int32),
    )
    road = mesh_of(*ROAD, material=np.full(2, materials.ASPHALT, np.int32))
    world = world_of(road, kinds=(kind,), motion=script, mover_classes=(0,))
    camera = camera_in(world, size=(160, 90), outputs=["instance"], hfov_deg=40.0)
    light_slot(camera, 0, **when)
    camera.geometry.place(script.at(np.zeros(1)))
    picture = camera.render(flat((0, 0, 0)))[0].astype(float)
    return picture, camera.outputs["instance"][0] == 0


def changed(a, b):
    """Pixels of the body that a lamp has changed, and by how much."""
    (before, body), (after, _) = a, b
    gain = after - before
    return (np.abs(gain).max(axis=2) > 12.0) & body, gain


@NIGHT_AND_NOON
@pytest.mark.parametrize("sort", ["car", "van", "truck", "bus", "trailer"])
def test_indicators_shine_amber_on_their_own_side(sort, when):
    kind = of_palette(sort)
    x = 8.0 + kind.half_length_m
    off = shoot(kind, when, x=x)
    columns = {}
    for lamp in (VehicleLamp.INDICATOR_LEFT, VehicleLamp.INDICATOR_RIGHT):
        where, gain = changed(off, shoot(kind, when, bits(lamp), x=x))
        assert where.sum() > 3
        red, green, blue = gain[where].mean(axis=0)
        assert red > green > blue
        columns[lamp] = np.flatnonzero(where.any(axis=0))
    assert columns[VehicleLamp.INDICATOR_LEFT].max() < 80  # the left half of 160
    assert columns[VehicleLamp.INDICATOR_RIGHT].min() >= 80


@NIGHT_AND_NOON
@pytest.mark.parametrize("sort", ["car", "van", "truck", "bus"])
def test_other_lamps_shine_at_their_end_in_their_colour(sort, when):
    kind = of_palette(sort)
    x = 8.0 + kind.half_length_m
    off = {yaw: shoot(kind, when, yaw=yaw, x=x) for yaw in (0.0, np.pi)}
    for lamp, yaw, white in (
        (VehicleLamp.REVERSING, 0.0, True),
        (VehicleLamp.FOG_REAR, 0.0, False),
        (VehicleLamp.FOG_FRONT, np.pi, True),
    ):
        where, gain = changed(off[yaw], shoot(kind, when, bits(lamp), yaw, x))
        assert where.sum() > 3, lamp
        red, _, blue = gain[where].mean(axis=0)
        assert (blue > 0.5 * red) == white, lamp
        hidden = changed(off[np.pi - yaw], shoot(kind, when, bits(lamp), np.pi - yaw, x))
        assert not hidden[0].any(), lamp


def test_lamps_that_a_scenario_switches_on_are_seen_by_day():
    car = of_palette("car")
    off, tail = shoot(car, NOON), shoot(car, NOON, bits(VehicleLamp.TAIL))
    redder = (tail[0] - off[0])[off[1]].mean(axis=0)
    assert redder[0] > redder[1] >= 0.0
    front = shoot(car, NOON, yaw=np.pi)
    head = shoot(car, NOON, bits(VehicleLamp.HEAD), np.pi)
    assert changed(front, head)[0].sum() > 3
    usual = shoot(car, NOON, lamps=0.0)
    assert (off[0] == usual[0]).all()  # the usual lamps go by the light of day


def test_high_beams_light_the_road_further_than_low_beams():
    car, x = of_palette("car"), 14.0
    low = shoot(car, NIGHT, bits(VehicleLamp.HEAD), np.pi, x)[0]
    high = shoot(car, NIGHT, bits(VehicleLamp.HEAD, VehicleLamp.HIGH_BEAM), np.pi, x)[0]
    alone = shoot(car, NIGHT, bits(VehicleLamp.HEAD, VehicleLamp.HIGH_BEAM), np.pi, x, 0.0)[0]
    dark = shoot(car, NIGHT, 0, np.pi, x, 0.0)[0]
    road = np.s_[70:88, 60:100]
    assert (low - dark)[road].mean() > 1.0
    assert (high - low)[road].mean() > 1.0
    assert (alone - dark)[road].mean() > 1.0


def traffic_light(signals, slots=1):
    """Three lenses of two traffic lights each, side by side, as every slot sees them."""
    points, faces, tags, colors = [], [], [], []
    for signal in range(2):
        for lamp, color in enumerate([(0.9, 0.05, 0.03), (0.9, 0.5, 0.02), (0.05, 0.8, 0.4)]):
            y, z = 1.0 - 2.0 * signal, 0.6 - 0.6 * lamp
            p, f = quad(
                (4, y - 0.25, z - 0.25),
                (4, y - 0.25, z + 0.25),
                (4, y + 0.25, z + 0.25),
                (4, y + 0.25, z - 0.25),
            )
            faces.append(f + 4 * len(points))
            points.append(p)
            tags += [8 * signal + lamp] * 2
            colors += [color] * 2
    mesh = mesh_of(
        np.concatenate(points),
        np.concatenate(faces),
        material=np.full(12, materials.SIGNAL_LAMP, np.int32),
        tag=np.array(tags, np.int32),
        color=np.array(colors, np.float32),
    )
    camera = camera_in(world_of(mesh, signals=("a", "b")), slots, size=(96, 54))
    for slot in range(slots):
        light_slot(camera, slot, **NIGHT)
    still = Script(position_m=np.zeros((0, 3))).at(np.zeros(slots))
    camera.geometry.place(replace(still, signals=np.asarray(signals, np.int32)))
    return camera.render(flat(*[(0, 0, 0)] * slots)).astype(float)


def test_a_lens_is_lit_in_the_slots_where_its_lamp_is_on():
    dark, red, green = traffic_light([[0, 0], [1, 0], [0, 4]], slots=3)
    assert dark.max() < 90
    lit = red - dark
    rows, columns = np.nonzero(lit.max(axis=2) > 60)
    assert len(rows) > 8
    assert rows.max() < 24  # the upper lens
    assert columns.max() < 48  # of the light on the left
    assert lit[rows, columns].mean(axis=0).argmax() == 0
    lit = green - dark
    rows, columns = np.nonzero(lit.max(axis=2) > 60)
    assert rows.min() > 29
    assert columns.min() >= 48
    assert lit[rows, columns].mean(axis=0).argmax() == 1
    alone = traffic_light([[0, 4]])[0]
    assert (alone == green).all()


def test_a_placement_that_says_nothing_leaves_the_signals_alone():
    world = world_of(mesh_of(*ROAD), signals=("a",))
    camera = camera_in(world)
    still = Script(position_m=np.zeros((0, 3))).at(np.zeros(1))
    camera.geometry.place(replace(still, signals=np.array([[5]], np.int32)))
    camera.geometry.place(still)
    assert camera.geometry.scene.signals.numpy().tolist() == [[5]]
