"""Options of the sampler that traces a boundary, and what may be wrong with them."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.sections.search import Choices, Search
from schemas.validation import Mistake, suggest


class BoundaryOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of boundary tracing."""

    x: str = ""
    """The one parameter; empty: the first of the section. All but these two stay at their
    medians."""
    y: str = ""
    """The other parameter; empty: the second of the section."""
    grid: Annotated[int, Meta(ge=2, le=50)] = 8
    """Cells of the first grid along each side; what is smaller than a cell may be missed."""
    width: Annotated[float, Meta(gt=0, le=0.5)] = 0.02
    """Widest bracket of a point of the boundary, as a share of the plane's side."""


def plane_of(names: list[str], options: BoundaryOptions) -> tuple[str, str]:
    """The two parameters in whose plane the boundary is traced."""
    return options.x or names[0], options.y or names[1]


def boundary_mistakes(search: Search, options: BoundaryOptions) -> list[Mistake]:
    """What is wrong with a section beside the types of its options."""
    names = list(search.parameters)
    if len(names) < 2:
        return []  # said where parameters are counted
    mistakes = []
    for option, name in zip(("x", "y"), plane_of(names, options), strict=True):
        where = f"search.options.{option}"
        if name not in names:
            mistakes.append(Mistake(where, f"no parameter '{name}'; {suggest(name, names)}"))
        elif isinstance(search.parameters[name], Choices):
            mistakes.append(Mistake(where, f"'{name}' has choices, which have no order"))
    if plane_of(names, options)[0] == plane_of(names, options)[1]:
        mistakes.append(Mistake("search.options.y", "the same as x; name another parameter"))
    if search.correlations:
        fixed = "a boundary is traced with all other parameters fixed; remove them"
        mistakes.append(Mistake("search.correlations", fixed))
    needed, cases = (options.grid + 1) ** 2, search.budget.cases
    if cases < needed:
        few = f"given {cases}, a grid of {options.grid} cells per side takes {needed}"
        mistakes.append(Mistake("search.budget.cases", f"{few}, and its boundary more"))
    return mistakes
