"""``conductor bench``: what the conductor costs, beside two other schedulers in the same run."""
