"""Results of a rulebook: the protocol's own tables, and ``rulebook.json``."""
