"""The inertial unit."""
