"""What the cameras and lidars of a rig take of a GPU, before anything is allocated."""

from __future__ import annotations

from schemas.case import Case
from schemas.sections.lidar import lidar_columns
from twin.render.memory import LidarLoad, MemoryPlan, plan
from twin.sensors.lidar.lidar import mounted_profile
from twin.vehicle.vehicle_file import Vehicle
from twin.world.street.build import World


def rig_memory(case: Case, vehicle: Vehicle, world: World, slots: int) -> MemoryPlan:
    """Memory for ``slots`` cases like ``case``.

    Raises:
        ValueError: the vehicle has no such lidar; one line.
    """
    profiles = [mounted_profile(vehicle.lidar(lidar.name)) for lidar in case.rig.lidars]
    return plan(
        case.rig.seeing,
        [
            LidarLoad(
                f"lidar.{lidar.name}",
                profile.channels * profile.columns,
                4 * len(lidar_columns(lidar)) + 16 * profile.sub_rays + 16,
            )
            for lidar, profile in zip(case.rig.lidars, profiles, strict=True)
        ],
        slots,
        triangles=sum(len(mesh.faces) for mesh in (world.mesh, *(k.mesh for k in world.kinds))),
        texture_bytes=4 * sum(image.size for image in world.textures) // 3,  # with mip levels
        instances=len(world.classes),
        objects=world.motion.count,
    )
