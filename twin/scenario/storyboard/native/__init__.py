"""Scenarios written by hand: a YAML format, and its compiler to storyboard programs."""
