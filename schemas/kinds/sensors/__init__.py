"""Declarations of the sensors that are shipped."""

from schemas.kinds.sensors import encoders, gnss, imu, pose, radar, radar_cube

KINDS = (encoders.KIND, gnss.KIND, imu.KIND, pose.KIND, radar.KIND, radar_cube.KIND)
"""Messages and files have them in this order."""

FIRST = ("encoders", "gnss", "imu", "pose")
"""Names of those whose sections stand in every message and file, as in the first version."""
