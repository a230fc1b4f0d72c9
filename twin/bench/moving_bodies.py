"""Camera frames per second with bodies that move in every picture, beside bodies that stand.

Both look at the same bodies in the same run. Bodies that move are put into their places before
every picture: their poses and the spheres around them are computed on the host and copied to the
device, as the simulator's loop does with the bodies of a storyboard.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import cycle

import msgspec
import numpy as np
import warp as wp

from twin.actors.motion import Placement
from twin.actors.palette import build_palette, class_index, nobody
from twin.base.progress import steps
from twin.bench.camera import SCENE, SIZES, CameraBench, Size, views
from twin.world.scene import load_scene
from twin.world.street.build import build_world

BODIES = 16
"""Bodies that every view sees."""
TARGET_SLOWER = 0.1
"""Share by which bodies that move may slow pictures down."""
PICTURE = "fast"
_PICTURE_S = 0.05
_PICTURES = 10
"""Of a turn on a GPU; on a CPU a turn is one."""
_POSES = 20
"""Places that the bodies go through, to and fro."""
_GAP_M = 7.0
_FIRST_M = 9.0
_ASIDE_M = (3.4, -3.4, 0.0)
_SPEED_MPS = 10.0
_CAR_M = (4.5, 1.8, 1.5)


@dataclass(frozen=True, slots=True)
class MovingBodies:
    """Frames per second of one camera per view."""

    size: Size
    bodies: int
    empty_frames_per_s: float
    """Nobody is there."""
    standing_frames_per_s: float
    moving_frames_per_s: float

    @property
    def slower(self) -> float:
        """Share of the rate with standing bodies that is lost when they move."""
        return 1.0 - self.moving_frames_per_s / self.standing_frames_per_s

    @property
    def missed(self) -> list[str]:
        """Targets that were missed."""
        if self.slower <= TARGET_SLOWER:
            return []
        return [f"{self.slower:.1%} of {TARGET_SLOWER:.0%} slower pictures with moving bodies"]


def measure(device: str, size: Size | None = None, rounds: int = 30) -> MovingBodies:
    """Render the bench's views of a street with bodies in it.

    Args:
        device: cpu or cuda:N.
        size: default: that of ``twin bench camera`` on such a device.
        rounds: short turns of one kind after the other; the best of each counts, since other load
            on the machine only ever slows one down. On a CPU the processor's time is taken.
    """
    size = size or SIZES[device.partition(":")[0]]
    scene = msgspec.structs.replace(load_scene(SCENE), objects=[])
    world = build_world(scene, BODIES)
    bench = CameraBench(world, size, device, PICTURE)
    at = views(world, size.slots)
    ways = np.concatenate([np.arange(_POSES), np.arange(_POSES)[::-1]]) * _SPEED_MPS * _PICTURE_S
    car = build_palette().look("car", _CAR_M, 0).kind
    places = [_placement(at.x_m, float(way_m), car) for way_m in ways]
    turns = cycle(places)

    def move() -> None:
        bench.place(next(turns))
        bench.launch()

    kinds: dict[str, tuple[Placement, Callable[[], None]]] = {
        "empty": (nobody(size.slots, BODIES), bench.launch),
        "standing": (places[_POSES // 2], bench.launch),
        "moving": (places[0], move),
    }
    best_s = dict.fromkeys(kinds, float("inf"))
    on_cpu = wp.get_device(device).is_cpu
    count, clock = (1, time.process_time) if on_cpu else (_PICTURES, time.perf_counter)
    for _ in steps("rounds of cameras", range(rounds + 1)):  # the first loads the kernels
        for name, (placement, launch) in kinds.items():
            bench.place(placement)
            wp.synchronize_device(device)
            begin = clock()
            for _ in range(count):
                launch()
            wp.synchronize_device(device)
            best_s[name] = min(best_s[name], (clock() - begin) / count)
    rates = {name: size.slots / spent_s for name, spent_s in best_s.items()}
    return MovingBodies(size, BODIES, rates["empty"], rates["standing"], rates["moving"])


def lines(figures: MovingBodies) -> list[str]:
    """The figures in words."""
    return [
        f"{figures.standing_frames_per_s:,.1f} frames/s of {figures.size.width}x"
        f"{figures.size.height} with {figures.bodies} standing bodies in each of "
        f"{figures.size.slots} views, {figures.moving_frames_per_s:,.1f} with moving ones "
        f"({figures.slower:+.1%} slower, target {TARGET_SLOWER:.0%}), "
        f"{figures.empty_frames_per_s:,.1f} with none"
    ]


def _placement(eyes_x_m: np.ndarray, way_m: float, car: int) -> Placement:
    """Cars in three lanes ahead of every view that have driven so far; ``car``: their kind."""
    slots = len(eyes_x_m)
    number = np.arange(BODIES)
    position = np.zeros((slots, BODIES, 3))
    position[..., 0] = eyes_x_m[:, None] + _FIRST_M + _GAP_M * (number // len(_ASIDE_M)) + way_m
    position[..., 1] = np.take(_ASIDE_M, number % len(_ASIDE_M))
    velocity = np.zeros_like(position)
    velocity[..., 0] = _SPEED_MPS
    return replace(
        nobody(slots, BODIES),
        kind=np.full((slots, BODIES), car, np.int32),
        position_m=position,
        velocity_mps=velocity,
        half_m=np.tile(np.array(_CAR_M[:2]) / 2.0, (slots, BODIES, 1)),
        class_index=np.full((slots, BODIES), class_index("car"), np.int32),
    )
