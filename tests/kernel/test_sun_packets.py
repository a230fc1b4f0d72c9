"""Rays to the sun in packets give the answers that each of them gets alone, to the last bit."""

import numpy as np
import pytest
import warp as wp
from pictures import Script, box_mesh, mesh_of, world_of

from twin.actors.motion import ObjectKind
from twin.render.trace.geometry import Geometry, RayScene, occluded
from twin.render.trace.sun_packet import LANES, Lanes, unblocked


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def both_kernel(
    scene: RayScene,
    starts: wp.array2d(dtype=wp.vec3),
    asked: wp.array(dtype=wp.int32),
    directions: wp.array(dtype=wp.vec3),
    far: wp.float32,
    together: wp.array(dtype=wp.int32),
    alone: wp.array(dtype=wp.int32),
):
    packet = wp.tid()
    x, y, z = Lanes(), Lanes(), Lanes()
    lane, bits = wp.int32(0), wp.int32(0)
    direction = directions[packet]
    while lane < starts.shape[1]:
        start = starts[packet, lane]
        x[lane] = start[0]
        y[lane] = start[1]
        z[lane] = start[2]
        if ((asked[packet] >> lane) & 1) != 0 and not occluded(scene, 0, start, direction, far):
            bits = bits | (1 << lane)
        lane += 1
    together[packet] = unblocked(scene, 0, x, y, z, asked[packet], direction, far)
    alone[packet] = bits


def answers(world, script, starts, asked, directions, far_m):
    """Bits of the rays that are free: of packets, and of rays alone."""
    device = wp.get_device("cpu")
    geometry = Geometry(world, 1, device)
    geometry.place(script.at(np.zeros(1)))
    count = len(starts)
    together, alone = (wp.zeros(count, dtype=wp.int32, device=device) for _ in range(2))
    given = [
        geometry.scene,
        wp.array(starts, dtype=wp.vec3, device=device),
        wp.array(asked, dtype=wp.int32, device=device),
        wp.array(directions, dtype=wp.vec3, device=device),
        far_m,
    ]
    wp.launch(both_kernel, count, given, [together, alone], device=device)
    return together.numpy(), alone.numpy()


@pytest.mark.parametrize("far_m", [3.0, 400.0])
@pytest.mark.parametrize("seed", range(3))
def test_faces_and_bodies(seed, far_m):
    rng = np.random.default_rng(seed)
    faces, packets, bodies = 800, 600, 12
    middle = rng.normal(size=(faces, 1, 3)) * 8.0
    size = 10.0 ** rng.uniform(-1.0, 0.8, (faces, 1, 1))
    points = (middle + rng.normal(size=(faces, 3, 3)) * size).reshape(-1, 3)
    mesh = mesh_of(points, np.arange(3 * faces).reshape(-1, 3))
    kind = ObjectKind("box", box_mesh((1.0, 0.5, 0.7)), 1.0, 0.5)
    script = Script(
        position_m=rng.normal(size=(bodies, 3)) * 6.0, yaw_rad=rng.uniform(-3, 3, bodies)
    )
    world = world_of(mesh, kinds=(kind,), motion=script, mover_classes=(0,) * bodies)
    # Neighbours, some of them far apart as across an edge of a roof.
    spread = 10.0 ** rng.uniform(-2.0, 1.0, (packets, 1, 1))
    starts = rng.normal(size=(packets, 1, 3)) * 9.0 + rng.normal(size=(packets, LANES, 3)) * spread
    asked = rng.integers(1, 1 << LANES, packets)
    asked[: packets // 3] = (1 << LANES) - 1
    directions = rng.normal(size=(packets, 3))
    directions[::7, rng.integers(3)] = 0.0
    directions[::11] = (0.0, 0.0, 1.0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    together, alone = answers(world, script, starts, asked, directions, far_m)
    np.testing.assert_array_equal(together, alone)
    free = sum(int(bits).bit_count() for bits in alone) / sum(int(a).bit_count() for a in asked)
    assert 0.02 < free < 0.98  # both answers occur
