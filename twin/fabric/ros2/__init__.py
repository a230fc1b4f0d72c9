"""The wire of ROS 2 over Zenoh (rmw_zenoh): key expressions, liveliness tokens, attachments."""
