"""Labelled images from the twin, for those who train detectors; docs/dataset.md explains them."""
