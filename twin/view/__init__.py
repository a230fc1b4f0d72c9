"""The view of a simulator: what it shows of its cases."""
