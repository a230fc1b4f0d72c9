"""What a report shows of a search."""
