"""Reads glTF 2.0 and GLB files: geometry, nodes and what cameras see of materials."""
