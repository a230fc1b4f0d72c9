"""Measurements of the speed of parts of the simulator."""
