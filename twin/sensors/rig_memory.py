"""What the cameras and lidars of a rig take of a GPU, before anything is allocated."""

from __future__ import annotations

from schemas.campaign import Case
from twin.render.memory import LidarLoad, MemoryPlan, plan
from twin.sensors.lidar import mounted_profile
from twin.vehicle.vehicle_file import Vehicle
from twin.world.street import World


def rig_memory(case: Case, vehicle: Vehicle, world: World, slots: int) -> MemoryPlan:
    """Memory for ``slots`` cases like ``case``.

    Raises:
        ValueError: the vehicle has no such lidar; one line.
    """
    profiles = {lidar.name: mounted_profile(vehicle.lidar(lidar.name)) for lidar in case.lidars}
    return plan(
        [case.camera, *case.cameras],
        [
            LidarLoad(f"lidar.{name}", profile.channels * profile.columns)
            for name, profile in profiles.items()
        ],
        slots,
        triangles=sum(len(mesh.faces) for mesh in (world.mesh, *(k.mesh for k in world.kinds))),
        texture_bytes=sum(image.size for image in world.textures),
        instances=len(world.classes),
        objects=world.motion.count,
    )
