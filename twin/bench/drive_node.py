"""A node in the manner of rmw_zenoh that looks at nothing; run by the bench.

It takes the messages of a tick in their bytes, and answers each tick with full brakes.
"""

from __future__ import annotations

import os

from schemas.messages import Command
from twin.fabric.ros2.graph import TopicType
from twin.fabric.ros2.names import EndpointQos
from twin.fabric.ros2.session import Message, Ros2Session
from twin.ros2.commands import write_plain
from twin.ros2.parts import nanoseconds_of
from twin.ros2.store import type_store

SEEN = {
    "/drivetwin/front_right/image_raw": "sensor_msgs/msg/Image",
    "/drivetwin/roof/points": "sensor_msgs/msg/PointCloud2",
    "/drivetwin/sensor/vehicle": "drivetwin_msgs/msg/SensorArray",
    "/drivetwin/tick": "drivetwin_msgs/msg/Tick",
}
COMMAND = "/drivetwin/command"
PATIENCE_S = 600.0


def main() -> None:
    """Answer until the bridge goes away."""
    store = type_store()
    session = Ros2Session.joined(os.environ, "bench")

    def of(type_name: str) -> TopicType:
        return TopicType(type_name, store.type_hash(type_name))

    for topic, type_name in SEEN.items():
        session.subscribe(topic, of(type_name), EndpointQos())
    out = session.publish(COMMAND, of("drivetwin_msgs/msg/DriveCommand"), EndpointQos())
    while (arrived := session.receive(PATIENCE_S)) is not None:
        if isinstance(arrived, Message) and arrived.topic == "/drivetwin/tick":
            tick = store.decode(SEEN[arrived.topic], arrived.payload)
            command = Command(0, 0, tick.tick, 0.0, 1.0, 0.0)
            stamp_ns = nanoseconds_of(tick.stamp)
            out.put(store.encode(write_plain(store, stamp_ns, command)), stamp_ns)


if __name__ == "__main__":
    main()
