"""Declarations of the shipped perception variants."""
