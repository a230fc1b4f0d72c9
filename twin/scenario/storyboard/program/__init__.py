"""Storyboard programs: what happens in a scenario, as records that no file format shows through."""
