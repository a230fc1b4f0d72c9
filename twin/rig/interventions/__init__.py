"""Interventions: somebody changes a running case from outside."""
