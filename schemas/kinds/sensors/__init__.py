"""Declarations of the shipped sensors."""
