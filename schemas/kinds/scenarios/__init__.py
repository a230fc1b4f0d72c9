"""Declarations of the scenario families that are shipped."""
