"""What the ray sensors of a rig take of a GPU, before anything is allocated."""

from __future__ import annotations

from schemas.case import Case
from twin.render.memory import MemoryPlan, material_bytes, plan
from twin.sensors.ray_kinds import ray_rigs
from twin.vehicle.vehicle_file import Vehicle
from twin.world.street.build import World


def rig_memory(case: Case, vehicle: Vehicle, world: World, slots: int) -> MemoryPlan:
    """Memory for ``slots`` cases like ``case``.

    Raises:
        ValueError: the vehicle has no such sensor; one line.
    """
    shared = plan(
        [],
        [],
        slots,
        triangles=sum(len(mesh.faces) for mesh in (world.mesh, *(k.mesh for k in world.kinds))),
        texture_bytes=material_bytes(world),
        objects=world.motion.count,
    )
    rows = [row for rig in ray_rigs() for row in rig.memory(case, vehicle, world)]
    return MemoryPlan(slots, (*shared.rows, *rows))
