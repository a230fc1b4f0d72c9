"""A case while it runs: what its slot remembers, and when its random numbers become others."""
