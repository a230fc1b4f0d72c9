"""A generated street: roadways, buildings, and what stands on it."""
