"""PBS Pro, OpenPBS, and what answers to the same names."""
