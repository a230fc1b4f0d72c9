"""Road networks as flat tables."""
