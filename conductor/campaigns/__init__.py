"""The shipped campaigns."""
