"""A traced boundary in values of its parameters, with the cases between which its points lie."""

from __future__ import annotations

import numpy as np

from conductor.search.driver import Closed, case_names, closed_history, traced
from conductor.search.space import DIGITS, values_of
from schemas.files.search_result import BoundaryPoint, SearchBoundary
from schemas.sections.search import Search, Value


def boundary_of(search: Search, closed: Closed) -> SearchBoundary | None:
    """The boundary after the closed generations; None: the sampler traces none, or it knows no
    point yet."""
    boundary = traced(search, closed)
    if boundary is None or not boundary.points:
        return None
    parameters = list(search.parameters)
    history = closed_history(search, closed)
    names = case_names(history)
    values = values_of(search, np.concatenate(history.u))
    axes = (boundary.x, boundary.y)
    points = []
    for point in boundary.points:
        holds, fails = (
            [float(values[n][axis]) for axis in axes] for n in (point.holds, point.fails)
        )
        points.append(
            BoundaryPoint(
                at=[_between(a, b, point.share) for a, b in zip(holds, fails, strict=True)],
                holds=names[point.holds],
                holds_at=holds,
                fails=names[point.fails],
                fails_at=fails,
                width=point.width,
            )
        )
    fixed: dict[str, Value] = {
        name: values[0][number] for number, name in enumerate(parameters) if number not in axes
    }
    return SearchBoundary(
        x=parameters[boundary.x],
        y=parameters[boundary.y],
        fixed=fixed,
        points=points,
        lines=[list(line) for line in boundary.lines],
    )


def _between(one: float, other: float, share: float) -> float:
    return float(f"{one + share * (other - one):.{DIGITS}g}")
