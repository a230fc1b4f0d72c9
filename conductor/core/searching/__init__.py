"""Searches in a conductor: what it knows of them, and how they grow."""
