"""Played scenarios in the viewer (`viewer play`)."""
