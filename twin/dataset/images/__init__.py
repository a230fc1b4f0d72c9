"""Images of a dataset: who is where, and what a camera sees of it."""
