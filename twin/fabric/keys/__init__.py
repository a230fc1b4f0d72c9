"""Keys of a fabric: authority, members, roles, and what was withdrawn."""
