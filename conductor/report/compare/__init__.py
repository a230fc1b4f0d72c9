"""Two runs of the same cases beside each other."""
