"""The bridge to nodes of ROS 2 on rmw_zenoh."""

from devkit.bridges.ros2.bridge import Ros2Bridge

__all__ = ["Ros2Bridge"]
