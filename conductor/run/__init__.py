"""``conductor run``: a campaign's checks, its local workers, its end."""
