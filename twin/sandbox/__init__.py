"""A sandbox around the stack under test, by bubblewrap (``bwrap``)."""
