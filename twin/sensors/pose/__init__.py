"""The true pose."""
