"""Roads as triangles: lanes, kerbs, marks and the ground around."""
