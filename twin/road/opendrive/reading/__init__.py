"""Reading of OpenDRIVE files: bytes to records."""
