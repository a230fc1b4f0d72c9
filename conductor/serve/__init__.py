"""The conductor process around the core."""
