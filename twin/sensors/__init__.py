"""Sensors: what the stack gets besides images."""
