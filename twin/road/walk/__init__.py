"""Warp functions with which kernels walk on the roads of a network."""
