"""Parameters of the bridge to ROS 2, under ``autonomy.parameters``."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from devkit.bridges.ros2.lockstep import Answer
from schemas.kinds.bridge import ROS2_KEYS


class Ros2Parameters(Struct, frozen=True, forbid_unknown_fields=True):
    """How the bridge meets its nodes."""

    table: str = "plain"
    """Topics: ``plain``, ``nav2``, ``autoware``, or the path of a ``.yaml`` file."""
    domain: Annotated[int, Meta(ge=0, le=232)] = 0
    """``ROS_DOMAIN_ID``."""
    rmw_zenoh: Literal["jazzy", "kilted", "rolling"] = "jazzy"
    """KeyFormat of ROS 2 whose types and keys are spoken; ``rolling`` also for Lyrical."""
    answer: Answer = "stamp"
    """What answers a tick. ``stamp``: a command with its time; ``step``: a call of
    ``/drivetwin/step``; ``newest``: whatever has come, for ``clock: realtime``."""
    command: str = ""
    """Topic of the command that moves the car; empty: the table's."""
    wait_for: str = ""
    """Topics, separated by spaces, that somebody has to subscribe to before a case begins, besides
    a publisher of the command."""
    restart: bool = True
    """The command is started anew for each case; false: it runs on, and ``/clock`` begins at 0
    again."""
    start_s: Annotated[float, Meta(gt=0, le=3600)] = 30.0
    """Longest time until the nodes are there [s]."""
    answer_s: Annotated[float, Meta(gt=0, le=3600)] = 30.0
    """Longest time until a tick is answered [s]."""
    shared_memory: bool = False
    """Large messages lie in memory that nodes of this host may map, where they can."""
    keys: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,64}\Z")] = ""
    """Name of a folder in ``~/.config/drivetwin/ros2`` for the keys of nodes that somebody else
    starts, instead of ``command``."""
    port: Annotated[int, Meta(ge=0, le=65_535)] = 0
    """Port for such nodes, on this host's loopback; 0: a free one."""
    aeb_brake: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Where a command does not say it: braking as hard as this counts as emergency braking."""


assert ROS2_KEYS in Ros2Parameters.__struct_fields__
