"""The satellite receiver."""
