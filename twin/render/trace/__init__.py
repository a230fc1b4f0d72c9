"""Rays and what they meet."""
