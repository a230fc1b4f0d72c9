"""How fast parts of the simulator are."""
