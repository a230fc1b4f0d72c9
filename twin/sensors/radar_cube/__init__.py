"""The range-Doppler-angle cube of a radar."""
