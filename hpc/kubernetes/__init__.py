"""Kubernetes: a campaign as plain objects, and jobs over the API."""
