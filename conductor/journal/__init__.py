"""The journal: durable facts, their hash chain, and who owns a state folder."""
