"""``conductor new``: files to begin with, which run as they are."""
