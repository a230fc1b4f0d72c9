"""Vehicles: their files, hulls and dynamics."""
