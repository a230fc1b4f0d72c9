"""File types of a run, and how files are read that somebody named."""
