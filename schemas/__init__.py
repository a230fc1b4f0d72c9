"""The contract: message types, topics, wire codec and file types shared by every package."""

SCHEMA_VERSION = 1
"""Wire and file schema version; a peer that speaks another one is refused."""
