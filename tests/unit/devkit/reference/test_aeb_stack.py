"""devkit.aeb: the whole stack on synthetic observations."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from camera_sites import camera_site
from lane_pictures import LanePainter

from devkit.aeb import AebStack
from devkit.lane.lateral import LateralParameters
from devkit.reference.control import Controller
from devkit.reference.lights import LightsSwitch
from devkit.reference.planning import Planner
from devkit.stack import Observation
from schemas.messages import BOXES_MAX, Command, Episode
from schemas.sections.perception import GroundTruthPerception
from twin.road.lane import straight

WIDTH, HEIGHT = 160, 90
AHEAD = (0.0, 66.0, 38.0, 30.0, 22.0, 600.0, 12.0)
PARKED = (0.0, 110.0, 38.0, 40.0, 20.0, 700.0, 12.0)


def episode(slot: int, token: int, contrast_min: float = 0.05) -> Episode:
    return Episode(
        v=1,
        seq=0,
        slot=slot,
        token=token,
        case=f"case-{token}",
        seed=1,
        model="default",
        perception=GroundTruthPerception(contrast_min=contrast_min),
        camera="front_right",
        width=WIDTH,
        height=HEIGHT,
        hfov_deg=70.0,
        control_period_ns=50_000_000,
        cameras=[camera_site(WIDTH, HEIGHT)],
    )


class World:
    """One case's synthetic sensors, a function of its tick only."""

    def __init__(self, token: int, boxes=(), appears: int = 0, lux=5e4, fog=0.0, contrast_min=0.05):
        self.token, self.boxes, self.appears = token, boxes, appears
        self.lux, self.fog, self.contrast_min = lux, fog, contrast_min

    def image(self, tick: int) -> np.ndarray:
        noise = np.random.default_rng([self.token, tick])
        image = np.full((HEIGHT, WIDTH, 3), 120.0)
        for _, x, y, w, h, _, _ in self.seen(tick):
            image[int(y) : int(y + h), int(x) : int(x + w)] = (60, 50, 50)
        return np.clip(image + 3.0 * noise.standard_normal(image.shape), 0, 255).astype(np.uint8)

    def seen(self, tick: int):
        return self.boxes if tick >= self.appears else ()

    def speed_mps(self, tick: int) -> float:
        return max(8.0 - 0.5 * max(tick - self.appears - 2, 0), 0.0)


def observe(worlds: list[World | None], tick: int, camera: bool = True) -> Observation:
    slots = len(worlds)
    frames = np.zeros((slots, HEIGHT, WIDTH, 3), np.uint8)
    boxes = np.zeros((slots, BOXES_MAX, 7), np.float32)
    count = np.zeros(slots, np.int32)
    vehicle, environment = np.zeros((slots, 7)), np.zeros((slots, 2))
    token = np.zeros(slots, np.int64)
    for slot, world in enumerate(worlds):
        if world is None:
            continue
        frames[slot] = world.image(tick)
        for row, box in enumerate(world.seen(tick)):
            boxes[slot, row] = box
            count[slot] += 1
        vehicle[slot, 0] = world.speed_mps(tick)
        environment[slot] = world.lux, world.fog
        token[slot] = world.token
    sensors = {"vehicle": vehicle, "environment": environment}
    if camera:
        sensors |= {"camera": frames, "boxes": boxes}
    return Observation(
        seq=tick,
        active=np.array([world is not None for world in worlds]),
        token=token,
        tick=np.full(slots, tick, np.int32),
        sim_time_ns=np.full(slots, tick * 50_000_000, np.int64),
        sensors=sensors,
        counts={"boxes": count} if camera else {},
    )


def drive(
    worlds: list[World | None], ticks: int = 25, every: int = 1, **parameters
) -> dict[int, list[Command]]:
    """Token -> its commands."""
    stack = AebStack(len(worlds), **parameters)
    for slot, world in enumerate(worlds):
        if world is not None:
            stack.reset(slot, episode(slot, world.token, world.contrast_min))
    commands = {world.token: [] for world in worlds if world is not None}
    for tick in range(ticks):
        for command in stack.step(observe(worlds, tick, tick % every == 0)):
            assert worlds[command.slot].token == command.token
            assert command.tick == tick
            commands[command.token].append(command)
    return commands


def test_brakes_for_the_car_ahead_and_holds():
    commands = drive([World(5, [AHEAD], appears=4)])[5]
    assert [c.aeb for c in commands] == [False] * 5 + [True] * 20
    for command in commands[5:]:
        assert (command.throttle, command.brake, command.steering_rad) == (0.0, 1.0, 0.0)
        assert command.lights.indicators == 3
    assert commands[4].lights.indicators == 0
    assert commands[3].detections == []
    assert [d.label for d in commands[4].detections] == ["car"]
    assert [c.trigger for c in commands] == [None] * 5 + [0] + [None] * 19


def test_keeps_braking_when_the_car_disappears():
    world = World(5, [AHEAD])
    stack = AebStack(1)
    stack.reset(0, episode(0, 5))
    for tick in range(2):
        stack.step(observe([world], tick))
    world.boxes = ()
    (command,) = stack.step(observe([world], 2))
    assert command.detections == []
    assert command.aeb
    assert command.brake == 1.0


def test_parked_car_is_reported_but_does_not_trigger():
    commands = drive([World(5, [PARKED])])[5]
    assert all(len(c.detections) == 1 and c.detections[0].confidence > 0.5 for c in commands)
    assert not any(c.aeb for c in commands)


def test_perception_variants_are_per_slot():
    commands = drive([World(1, [AHEAD]), World(2, [AHEAD], contrast_min=1.0)])
    assert commands[1][-1].aeb
    assert not commands[2][-1].aeb


def test_slow_camera_counts_frames_not_ticks():
    commands = drive([World(5, [AHEAD])], every=4, frames_min=3)[5]
    assert [c.aeb for c in commands].index(True) == 8
    assert [bool(c.detections) for c in commands[:9]] == [t % 4 == 0 for t in range(9)]


def test_slot_independence_to_the_last_bit():
    worlds = [
        World(11, [AHEAD, PARKED], appears=3),
        World(12, [PARKED], lux=200.0),
        World(13, [AHEAD], appears=7, fog=0.02, contrast_min=0.2),
        World(14, [], lux=1500.0),
    ]
    alone = {world.token: drive([world])[world.token] for world in worlds}
    for order in ([0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]):
        together = drive([worlds[i] for i in order])
        with_gap = drive([None, *(worlds[i] for i in order), None, None])
        for token, commands in alone.items():
            for others in (together, with_gap):
                moved = [msgspec.structs.replace(c, slot=0) for c in others[token]]
                assert msgspec.msgpack.encode(moved) == msgspec.msgpack.encode(commands)
    assert {c[-1].aeb for c in alone.values()} == {True, False}


class Street(World):
    """A car that stands beside the middle of a painted lane."""

    def __init__(self, token: int, offset_m: float):
        super().__init__(token)
        self.offset_m = offset_m

    def image(self, tick: int) -> np.ndarray:
        lane = straight(-50.0, 100.0)
        painter = LanePainter(camera_site(WIDTH, HEIGHT), lane, seed=self.token + tick)
        return painter.picture(0.0, self.offset_m, 0.0)


def test_visual_servoing_is_slot_independent_and_straight_looks_at_nothing():
    worlds = [Street(21, 0.4), Street(22, -0.3), World(23)]
    alone = {w.token: drive([w], 8, steering="visual")[w.token] for w in worlds}
    together = drive([worlds[1], None, worlds[2], worlds[0]], 8, steering="visual")
    for token, commands in alone.items():
        moved = [msgspec.structs.replace(c, slot=0) for c in together[token]]
        assert msgspec.msgpack.encode(moved) == msgspec.msgpack.encode(commands)
    left, right, nothing = (alone[w.token][-1].steering_rad for w in worlds)
    assert left < -0.02  # back to the right
    assert right > 0.02
    assert nothing == 0.0
    assert not any(c.steering_rad for c in drive([worlds[0]], 8)[21])


def test_reset_forgets_the_old_case():
    stack = AebStack(2)
    stack.reset(0, episode(0, 1))
    for tick in range(4):
        stack.step(observe([World(1, [AHEAD], lux=10.0, fog=0.1), None], tick))
    fresh = World(9, [PARKED], lux=1500.0, fog=0.005)
    stack.reset(0, episode(0, 9))
    again = [stack.step(observe([fresh, None], tick))[0] for tick in range(6)]
    assert again == drive([fresh], ticks=6)[9]


def test_lights_follow_the_environment():
    night_fog = drive([World(1, lux=5.0, fog=0.02)], ticks=1)[1][0].lights
    assert (night_fog.low, night_fog.high, night_fog.parking, night_fog.fog) == (
        True,
        False,
        True,
        True,
    )


def test_a_slot_that_was_not_reset_is_refused():
    stack = AebStack(1)
    with pytest.raises(ValueError, match="slot 0: observation of token 5, but reset for none"):
        stack.step(observe([World(5)], 0))
    stack.reset(0, episode(0, 4))
    with pytest.raises(ValueError, match="token 5, but reset for 4"):
        stack.step(observe([World(5)], 0))


def test_parameters_are_the_fields_of_the_parts():
    types = (Planner, Controller, LateralParameters, LightsSwitch)
    parts = [msgspec.structs.asdict(type_()) for type_ in types]
    defaults = {name: value for part in parts for name, value in part.items()}
    assert len(defaults) == sum(len(part) for part in parts), "a field of two parts"
    stack, given = AebStack(1), AebStack(1, **defaults)
    built = (stack.planner, stack.controller, stack.steering, stack.switch)
    assert built == (given.planner, given.controller, given.steering, given.switch)
    assert [type(part) for part in built] == list(types)
    assert AebStack(1, cruise_speed_mps=3.0).planner.cruise_speed_mps == 3.0
    with pytest.raises(TypeError, match="unexpected parameter 'cruise_mps'"):
        AebStack(1, cruise_mps=3.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"cruise_speed_mps": -1.0}, "autonomy.parameters: cruise_speed_mps: given -1"),
        ({"frames_min": 0}, "frames_min: given 0, allowed: a whole number >= 1"),
        ({"frames_min": 1.5}, "frames_min: given 1.5"),
        ({"throttle_max": "full"}, "throttle_max: given 'full'"),
        ({"corridor_half_m": True}, "corridor_half_m: given True"),
        ({"cruise": "coast"}, "cruise: given 'coast', allowed: speed, throttle"),
        ({"cruise_throttle": 0.3}, "cruise_throttle is set, but cruise: speed"),
        (
            {"cruise": "throttle", "throttle_gain": 1.0},
            "throttle_gain is set, but cruise: throttle",
        ),
        ({"cruise": "throttle", "cruise_speed_mps": 5.0}, "cruise_speed_mps is set, but cruise"),
        ({"steering": "blind"}, "steering: given 'blind', allowed: straight, visual"),
        ({"preview_s": 1.0}, "preview_s is set, but steering: straight"),
        (
            {"steering": "visual", "preview_s": 0.1},
            "preview_s: given 0.1, allowed: a number >= 0.2 and <= 3",
        ),
        ({"bright_above_lx": 1.0}, "bright_above_lx: given 1, allowed: at least dark_below_lx"),
    ],
)
def test_parameters_out_of_range(parameters, message):
    with pytest.raises(ValueError, match=message):
        AebStack(1, **parameters)


def test_autodrive_rules_brake_at_once_and_let_go_again():
    class Passing(World):
        def seen(self, tick: int):
            return self.boxes if 5 <= tick < 9 else ()

    commands = drive([Passing(3, [AHEAD])], 15, rules="autodrive")[3]
    assert [tick for tick, c in enumerate(commands) if c.aeb] == [5, 6, 7, 8]
    assert [c.brake for c in commands[5:9]] == [1.0] * 4
    latched = drive([Passing(3, [AHEAD])], 15)[3]
    assert [tick for tick, c in enumerate(latched) if c.aeb] == list(range(6, 15))
