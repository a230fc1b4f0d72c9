"""OpenDRIVE 1.4 to 1.8: roads and lanes of a file, places on them, ways between them."""
