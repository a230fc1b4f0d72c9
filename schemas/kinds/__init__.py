"""Kinds of which there will be more: what each declares, in one table per group."""
