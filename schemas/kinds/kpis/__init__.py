"""Declarations of the KPIs that are shipped."""
