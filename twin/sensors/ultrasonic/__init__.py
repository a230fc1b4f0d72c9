"""Ultrasonic rangers: a few short cones of rays."""
