"""The fusion stack: camera, LiDAR and radar agree before the car brakes, and it lets go again."""

from devkit.fusion.stack import FusionStack

__all__ = ["FusionStack"]
