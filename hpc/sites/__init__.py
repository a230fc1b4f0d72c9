"""One campaign on several clusters: which there are, allocations at each, and how many."""
