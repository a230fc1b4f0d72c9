"""Records and shows running cases; the only package that imports rerun, and nobody imports it."""
