"""A ROS 2 node in lockstep: holds 5 m/s, and stops for what a camera shows (ros2.md)."""

import numpy as np
import rclpy
from ackermann_msgs.msg import AckermannDriveStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

CAMERA, COMMAND = "/camera/front_right", "/drive"


class Driver(Node):
    """One command per /clock, with its stamp: that is what lets the clock move on."""

    def __init__(self):
        super().__init__("driver")
        self.stopping = False
        self.last_ns = -1
        # Subscriptions first. A case begins when the publisher of the command is there.
        self.create_subscription(Image, CAMERA, self.see, 10)
        self.create_subscription(Clock, "/clock", self.drive, 10)
        self.command = self.create_publisher(AckermannDriveStamped, COMMAND, 10)

    def see(self, image):
        """A picture of this instant; it was sent before the clock."""
        self.image = image

    def drive(self, clock):
        """The clock is the last message of a tick: decide, and answer it."""
        now_ns = clock.clock.sec * 10**9 + clock.clock.nanosec
        if now_ns < self.last_ns:  # a new case, if the campaign says restart: false
            self.stopping = False
        self.last_ns = now_ns
        self.stopping |= self.is_blocked(clock.clock)
        answer = AckermannDriveStamped()
        answer.header.stamp = clock.clock
        answer.header.frame_id = "base_link"
        answer.drive.speed = 0.0 if self.stopping else 5.0
        answer.drive.steering_angle = 0.0
        self.command.publish(answer)

    def is_blocked(self, stamp):
        """Whether the middle of the newest picture is dark. Put your own perception here."""
        image = getattr(self, "image", None)
        if image is None or image.header.stamp != stamp:
            return False  # a camera is slower than the control rate
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
        rows, columns = image.height // 3, image.width // 3
        return bool(pixels[rows : 2 * rows, columns : 2 * columns].mean() < 40)


def main():
    """Spin until the bridge ends the process with its case."""
    rclpy.init()
    rclpy.spin(Driver())


if __name__ == "__main__":
    main()
