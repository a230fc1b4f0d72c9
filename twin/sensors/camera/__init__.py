"""Ray-traced cameras of a rig, with their boxes."""
