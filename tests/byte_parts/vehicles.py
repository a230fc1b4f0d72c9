"""Physics of random vehicle states, and the quick operations of pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from twin.base.portable import quick
from twin.vehicle.columns import COLUMN, TELEMETRY
from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import drivable
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from twin.world.street.build import build_world

STATES, BATCH = 1 << 20, 1 << 16
STEPS = 4


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def quick_kernel(
    # state in
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    # out
    out: wp.array2d(dtype=wp.float32),
):
    """Quotients, reciprocals, roots, decays, and an entry of unit vectors."""
    i = wp.tid()
    out[0, i] = quick.quotient(a[i], b[i])
    out[1, i] = quick.reciprocal(b[i])
    out[2, i] = quick.root(b[i])
    out[3, i] = quick.decay(wp.abs(a[i]))
    out[4, i] = quick.unit(wp.vec3(a[i], b[i], 1.0))[0]


def division(found: Any) -> None:
    """Quick operations on numbers from 2**-40 to 2**40; divisors and roots of all mantissas."""
    rng = np.random.default_rng(1)
    count = 1 << 24
    size = rng.choice((-1.0, 1.0), count) * 2.0 ** rng.integers(-40, 40, count)
    a = (rng.uniform(1.0, 2.0, count) * size).astype(np.float32)
    b = np.arange(0x3F800000, 0x3F800000 + count, dtype=np.uint32).view(np.float32)
    out = wp.zeros((5, count), dtype=wp.float32, device=found.device)
    given = [wp.array(part, dtype=wp.float32, device=found.device) for part in (a, b)]
    wp.launch(quick_kernel, count, given, [out], device=found.device)
    names = ("quotients", "reciprocals", "roots", "decays", "unit vectors")
    for name, values in zip(names, out.numpy(), strict=True):
        found.add(name, values, sample=values[: 1 << 16])


def vehicle(found: Any) -> None:
    """Random states on the plane and on a street with kerbs, walls and moving bodies."""
    world = build_world(load_scene("downtown"))
    device = wp.get_device(found.device)
    size = min(BATCH, found.count(BATCH))
    fleets = {
        "plane": Fleet([load_vehicle("opencav")], size, device),
        "street": Fleet(
            [load_vehicle("opencav")], size, device, colliders=world.colliders,
            ground=drivable(world, device), movers=4,
        ),
    }  # fmt: skip
    batches = found.count(STATES // BATCH) if found.share < 1.0 else STATES // BATCH
    for batch in range(batches):
        for name in [("plane", "street")[batch % 2]]:
            fleet = fleets[name]
            rng = np.random.default_rng(batch)
            _scatter(fleet, rng, size, first=batch < 2)
            fleet.refresh()
            measured = fleet.state.copy()
            fleet.advance(STEPS)
            fleet.survey(fleet.movers)
            sample = fleet.state[:256] if batch < 2 else None
            found.add(
                f"vehicles {batch} {name}", measured, fleet.state, fleet.events[:, :4],
                fleet.event_count, fleet.nearest(), sample=sample,
            )  # fmt: skip


def _scatter(fleet: Fleet, rng: np.random.Generator, size: int, *, first: bool) -> None:
    if first:  # the rest of a placed row is the same for all
        fleet.place(0, 0.0, 8.0, 0.85, refresh=False)
        fleet.state[:] = fleet.state[0]
        fleet.commands[:] = fleet.commands[0]
        fleet.active[:] = 1

    def spread(column: str, low: float, high: float) -> None:
        fleet.state[:, 0, COLUMN[column]] = rng.uniform(low, high, size)

    spread("com_x_m", -20.0, 300.0)
    spread("com_y_m", -9.0, 9.0)
    spread("com_z_m", 0.3, 0.9)
    turn = np.concatenate([rng.normal(0.0, 0.1, (size, 2)), rng.normal(0.0, 1.0, (size, 2))], 1)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    first_turn = COLUMN["orientation_x"]
    fleet.state[:, 0, first_turn : first_turn + 4] = turn
    for axis, most in zip("xyz", (30.0, 30.0, 2.0), strict=True):
        spread(f"velocity_{axis}_mps", -most, most)
        spread(f"rate_{axis}_radps", -1.0, 1.0)
    wheels = [name for name in TELEMETRY if name.startswith("wheel_speed")]
    for name in wheels:
        spread(name, -90.0, 90.0)
    spread("steering_rad", -0.5, 0.5)
    spread("rpm", 800.0, 5000.0)
    fleet.state[:, 0, COLUMN["gear"]] = rng.integers(-1, 6, size)
    fleet.commands[:, 0, :, 0] = rng.uniform(0.0, 1.0, (size, 1))
    fleet.commands[:, 0, :, 1] = rng.uniform(0.0, 1.0, (size, 1)) * (rng.random((size, 1)) < 0.3)
    fleet.commands[:, 0, :, 2] = rng.uniform(-0.5, 0.5, (size, 1))
    fleet.friction[:] = rng.uniform(0.1, 1.0, size)
    fleet.wind[:] = rng.normal(0.0, 6.0, (size, 2))
    if fleet.movers.shape[1]:
        shape = fleet.movers.shape[:2]
        near = fleet.state[:, 0, [COLUMN["com_x_m"], COLUMN["com_y_m"]]]
        fleet.movers[:, :, :2] = near[:, None] + rng.normal(0.0, 6.0, (*shape, 2))
        fleet.movers[:, :, 2] = rng.uniform(-3.0, 3.0, shape)
        fleet.movers[:, :, 3:5] = rng.uniform(0.3, 2.5, (*shape, 2))
        fleet.movers[:, :, 5:] = rng.normal(0.0, 3.0, (*shape, fleet.movers.shape[2] - 5))
