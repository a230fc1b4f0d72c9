"""Sections of a campaign file, one module each."""
