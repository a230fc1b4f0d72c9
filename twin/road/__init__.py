"""Roads as lines to follow."""
