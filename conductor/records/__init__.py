"""What a campaign leaves for readers: outcomes, timeline, fingerprint."""
