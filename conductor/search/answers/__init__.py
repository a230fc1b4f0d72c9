"""What is made of a search that has ended: pure functions of its closed generations."""
