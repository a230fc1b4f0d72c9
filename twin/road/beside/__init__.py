"""What stands beside roads: places of objects and signals in the world, without looks."""
