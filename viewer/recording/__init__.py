"""Messages of the view plane as Rerun recordings."""
