"""Searches: from results of closed generations to the next proposals, and to an answer."""
