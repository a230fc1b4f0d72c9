"""Recorded drives of others (ROS 2, MCAP or rosbag2) become scenarios."""
