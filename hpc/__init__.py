"""Turns a campaign into a job script for a cluster's batch system."""
