"""What stands beside OpenDRIVE roads: their objects and signals, and scenery of scene files."""
