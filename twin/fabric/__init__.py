"""The fabric: bus, sessions, clock, errors, processes and shared frames."""
