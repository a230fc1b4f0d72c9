"""Scenarios: where an ego starts, when its case ends, what it comes to; a folder per family."""
