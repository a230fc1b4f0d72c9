"""The processes that render a dataset."""
