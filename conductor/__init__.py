"""The conductor: hands cases to workers and records exactly one outcome for each."""
