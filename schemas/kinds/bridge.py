"""The table of bridges: protocols that a stack may speak instead of the drive plane."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.bridges"
"""Entry points that bring bridges."""

OURS = {"shipped": "schemas.kinds.bridge:KINDS"}
"""Bridges that are shipped; the same as in pyproject.toml."""

NONE = "none"
"""Word in place of a name: the stack speaks the drive plane itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeKind:
    """Declaration of a bridge."""

    name: str
    doc: str
    """One sentence for docs."""
    implementation: str
    """``module:Class``, a :class:`devkit.bridges.ScriptBridge` that translates."""
    packages: tuple[str, ...] = ()
    """Packages that it imports."""
    installed_by: str = ""
    """What ``pip install`` takes to have them."""
    port: int = 0
    """Port at which its scripts listen, unless ``parameters.port`` says another; 0: at none."""
    slots_max: int = 1
    """Cars that one script drives."""
    sensors: tuple[str, ...] = ()
    """Sections of the vehicle's sensors that it sends."""
    cameras: tuple[str, ...] = ()
    """Names of the cameras whose pictures it sends."""
    alone: str = ""
    """Parameter without which it needs a command: with it, somebody else starts the script."""
    unpaced: tuple[str, str] = ("", "")
    """Parameter and its value with which it waits for nobody: only with ``clock: realtime``."""

    def lacking(self) -> tuple[str, ...]:
        """Packages of it that this installation has not."""
        return tuple(name for name in self.packages if not importlib.util.find_spec(name))


AUTODRIVE = BridgeKind(
    name="autodrive",
    doc="the command is a script of the AutoDRIVE devkit, which waits for the AutoDRIVE Simulator",
    implementation="devkit.bridges.autodrive:AutodriveBridge",
    packages=("websockets",),
    installed_by="drivetwin[autodrive]",
    port=4567,
    sensors=("encoders", "imu", "pose"),
    cameras=("front_left", "front_right"),
)
"""Scripts of the AutoDRIVE devkit."""

ROS2_KEYS = "keys"
"""Parameter of the bridge to ROS 2 that names a folder for keys."""

ROS2 = BridgeKind(
    name="ros2",
    doc="the command is a ROS 2 node, or whatever starts some, on rmw_zenoh",
    implementation="devkit.bridges.ros2:Ros2Bridge",
    packages=("rosbags", "xxhash"),
    installed_by="drivetwin[ros2]",
    alone=ROS2_KEYS,
    unpaced=("answer", "newest"),
)
"""Nodes of ROS 2."""

KINDS = (AUTODRIVE, ROS2)
"""Bridges that are shipped."""


@cache
def bridges() -> Kinds[BridgeKind]:
    """All bridges, the shipped ones first."""
    return read_kinds(GROUP, BridgeKind, OURS)


def lacking_bridges() -> dict[str, str]:
    """Bridges that cannot run in this installation, with what to do, in a line."""
    return {
        kind.name: f"no package {', '.join(lacking)}: pip install '{kind.installed_by}'"
        for kind in bridges().declared
        if (lacking := kind.lacking())
    }


if TYPE_CHECKING:
    BridgeChoice = str
else:
    BridgeChoice = Literal[(NONE, *bridges().names())]
