"""ROS 2 messages: types, their hashes and bytes, and conversions from and to the drive plane.

Nothing here speaks to anybody: sessions are `twin.fabric`'s, recordings `viewer`'s.
"""
