"""The 3D LiDAR."""
