"""Distributions and budgets of a search that are allowed by their types, and yet make no sense."""

from __future__ import annotations

import math

from msgspec import UNSET

from schemas.sections.search import Choices, Distribution, Integers, SearchBudget
from schemas.validation import Mistake

HALF_WIDTH_MAX = 0.5
"""Half the width of the interval from 0 to 1, which says nothing."""
_CONSTANT = "can have one value only; an axis with one value belongs into the matrix"


def constant_problem(distribution: Distribution) -> str:
    """One line if a distribution has one value only, or nothing."""
    match distribution:
        case Choices():
            weights = distribution.weights or [1.0] * len(distribution.values)
            return "" if sum(weight > 0 for weight in weights) > 1 else _CONSTANT
        case Integers():
            return ""
        case _:
            low = getattr(distribution, "low", -math.inf)
            high = getattr(distribution, "high", math.inf)
            if not distribution.whole or not math.isfinite(high - low):
                return ""
            return _CONSTANT if round(low) == round(high) else ""


def budget_mistakes(budget: SearchBudget, sampler: str, generation_min: int) -> list[Mistake]:
    """What is wrong with a budget for a sampler whose generations have so many cases."""
    mistakes = []
    if budget.generation < generation_min:
        fewest = f"given {budget.generation}, sampler {sampler} needs at least {generation_min}"
        mistakes.append(Mistake("search.budget.generation", fewest))
    if budget.half_width is not UNSET and budget.half_width > HALF_WIDTH_MAX:
        widest = f"given {budget.half_width:g}, allowed: at most {HALF_WIDTH_MAX:g}, all there is"
        mistakes.append(Mistake("search.budget.half_width", widest))
    return mistakes
