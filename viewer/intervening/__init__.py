"""Interventions from the command line."""
