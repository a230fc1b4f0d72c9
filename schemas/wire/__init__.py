"""What travels: topics, the wire codec, and messages of the planes."""
