"""Decisions of the conductor, pure: no clock, file, socket, thread or random number."""
