"""Ray-traced cameras."""
