"""What a node of ROS 2 sends: its tokens, its attachments, and its commands to pedals."""

from __future__ import annotations

from fuzz_target import Target

from devkit.bridges.ros2.controllers import AskedError, MotionControl
from devkit.bridges.ros2.driving import AskedTick, RosDriver, TickMistakeError
from schemas.messages import command_mistake
from twin.fabric.ros2.attachment import AttachmentError, parse_attachment
from twin.fabric.ros2.graph import Graph, TopicType
from twin.fabric.ros2.names import RELEASES, NameMistakeError, parse_token
from twin.ros2.commands import read_command
from twin.ros2.store import MessageError, type_store
from twin.ros2.tables import COMMAND_TYPES

DRIVE = TopicType("geometry_msgs/msg/Twist", "RIHS01_" + "0" * 64)


def _token(data: bytes) -> object:
    token = data.decode("utf-8", "replace")
    graph = Graph("0", RELEASES["jazzy"], {"/drive": DRIVE})
    graph.change(token, True)
    graph.expect("/chatter", DRIVE)
    assert all("\n" not in line for line in [*graph.take_lines(), *graph.nodes()])
    graph.change(token, False)
    assert graph.nodes() == []
    return parse_token(token)


def _attachment(data: bytes) -> object:
    return parse_attachment(data)


def _command(data: bytes) -> object:
    """The first byte says which type; what comes of it is a command or a mistake in it."""
    type_name = COMMAND_TYPES[data[0] % len(COMMAND_TYPES)] if data else COMMAND_TYPES[0]
    demand = read_command(type_store(), type_name, data[1:])
    driver = RosDriver(MotionControl(), 0.05, 1.0)
    command = driver.command("/drive", {"/drive": demand}, AskedTick(0, 0, 7, 1.0))
    return command_mistake(command)


TARGETS = {
    "ros2-token": Target(_token, (NameMistakeError,)),
    "ros2-attachment": Target(_attachment, (AttachmentError,)),
    "ros2-pedals": Target(_command, (MessageError, AskedError, TickMistakeError)),
}
