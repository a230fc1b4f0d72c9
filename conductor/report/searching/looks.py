"""Looks of a search's cases, in all of its figures."""

from __future__ import annotations

from schemas.files.search_result import SearchFile

FAILED, HELD, LIMIT = "#c0392b", "#3a6ea5", "#888888"
"""Colours of cases that failed, of those that did not, and of the limit between them."""


def fails(file: SearchFile, value: float | None) -> bool:
    """Whether a value of the KPI is a failure; a missing one is not drawn."""
    if value is None:
        return False
    if file.fails_below is not None:
        return value < file.fails_below
    return file.fails_above is not None and value > file.fails_above
