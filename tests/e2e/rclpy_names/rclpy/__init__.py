"""rclpy's names, as far as docs/examples/ros2_node.py uses them, over a stranger's session.

rclpy cannot be installed where these tests run. Its example's own lines run all the same: messages
come and go over the wire, by zenoh_ros2_sdk.
"""

import os
import queue
import sys
import types
from pathlib import Path

import zenoh
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.message_registry import get_registry
from zenoh_ros2_sdk.session import ZenohSession

FOLDER, DOMAIN = Path(sys.argv[1]), int(os.environ["ROS_DOMAIN_ID"])
INBOX = queue.SimpleQueue()


def init():
    """Nothing to do: the session opens by itself."""


def spin(node):
    """Callbacks one after the other, in the order of arrival."""
    while True:
        callback, message = INBOX.get()
        callback(message)


def loaded(message_class):
    """Text of a type's definition, and its name."""
    get_registry().messages_dir = FOLDER
    get_registry().load_message_type(message_class.NAME)
    return message_class.NAME, (FOLDER / f"{message_class.NAME}.msg").read_text()


class _Subscriber(ROS2Subscriber):
    """As rmw_zenoh takes messages: all in one thread. In the package's own way each topic has one,
    and a clock overtakes the picture that was sent before it."""

    @property
    def _listener(self):
        return zenoh.handlers.Callback(super()._listener, indirect=False)


class _Publisher:
    def __init__(self, *words, **named):
        self.out = ROS2Publisher(*words, **named)

    def publish(self, message):
        kinds = self.out.session_mgr.store.types
        header = kinds["std_msgs/msg/Header"](**vars(message.header))
        drive = kinds["ackermann_msgs/msg/AckermannDrive"](**vars(message.drive))
        self.out.publish(header=header, drive=drive)


class _Node:
    def __init__(self, name):
        self.named = {"node_name": name, "domain_id": DOMAIN}
        self.kept = []

    def create_subscription(self, message_class, topic, callback, depth):
        name, text = loaded(message_class)
        take = lambda message: INBOX.put((callback, message))  # noqa: E731
        self.kept.append(_Subscriber(topic, name, take, msg_definition=text, **self.named))

    def create_publisher(self, message_class, topic, depth):
        name, text = loaded(message_class)
        return _Publisher(topic, name, msg_definition=text, **self.named)


class AckermannDriveStamped:
    """A message with the fields that it begins with."""

    NAME = "ackermann_msgs/msg/AckermannDriveStamped"

    def __init__(self):
        time = ZenohSession.get_instance().store.types["builtin_interfaces/msg/Time"]
        self.header = types.SimpleNamespace(stamp=time(sec=0, nanosec=0), frame_id="")
        zeros = ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
        self.drive = types.SimpleNamespace(**dict.fromkeys(zeros, 0.0))


class Clock:
    NAME = "rosgraph_msgs/msg/Clock"


class Image:
    NAME = "sensor_msgs/msg/Image"


for module, content in (
    ("rclpy.node", {"Node": _Node}),
    ("ackermann_msgs.msg", {"AckermannDriveStamped": AckermannDriveStamped}),
    ("rosgraph_msgs.msg", {"Clock": Clock}),
    ("sensor_msgs.msg", {"Image": Image}),
):
    sys.modules.setdefault(module.partition(".")[0], types.ModuleType(module.partition(".")[0]))
    sys.modules[module] = types.ModuleType(module)
    vars(sys.modules[module]).update(content)
