"""Looks of a search's cases, in all of its figures."""

from __future__ import annotations

FAILED, HELD, LIMIT = "#c0392b", "#3a6ea5", "#888888"
"""Colours of cases that failed, of those that did not, and of the limit between them."""
