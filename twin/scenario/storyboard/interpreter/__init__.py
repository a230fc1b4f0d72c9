"""Kernels that interpret storyboard programs, and the functions they consist of."""
