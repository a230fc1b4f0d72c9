"""``viewer bench``: what looking costs."""
