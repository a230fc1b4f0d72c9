"""Permutations of a parameter distribution: deterministic ones in file order, the last fastest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from schemas.identity import stream_key
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.expression import Value

PERMUTATIONS_MAX = 100_000
"""Permutations of one file."""
_STEP_TOLERANCE = 1e-9
_DRAWS_MAX = 1000
Assignment = dict[str, Value]


def permutations(distribution: ScenarioElement) -> list[Assignment]:
    """Parameter values of every permutation of a ``ParameterValueDistribution``.

    Raises:
        ValueError: one line with file and line.
    """
    fixed = distribution.first("Deterministic")
    if fixed is not None:
        return _deterministic(fixed)
    drawn = distribution.first("Stochastic")
    assert drawn is not None
    return _stochastic(drawn)


def _deterministic(element: ScenarioElement) -> list[Assignment]:
    axes: list[list[Assignment]] = []
    for child in element.children:
        if child.name == "DeterministicMultiParameterDistribution":
            axes.append([_value_set(s) for s in child.walk() if s.type_name == "ParameterValueSet"])
        else:
            name = str(child.values["parameterName"])
            axes.append([{name: value} for value in _single(child.children[0])])
    names = [name for axis in axes for name in axis[0]] if all(axes) else []
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise _fault(element, f"parameter {twice} is distributed twice")
    if math.prod(len(axis) for axis in axes) > PERMUTATIONS_MAX:
        raise _fault(element, f"more than {PERMUTATIONS_MAX} permutations")
    return [
        {name: value for part in parts for name, value in part.items()}
        for parts in itertools.product(*axes)
    ]


def _value_set(element: ScenarioElement) -> Assignment:
    return {str(a.values["parameterRef"]): a.values["value"] for a in element.children}


def _single(element: ScenarioElement) -> list[Value]:
    if element.name == "DistributionSet":
        return [item.values["value"] for item in element.children]
    low, high = _range(element)
    step = float(element.values["stepWidth"])
    if not 0 < step < math.inf:
        raise _fault(element, f"stepWidth is {step:g}, it must be above 0 and finite")
    count = (high - low) / step
    if not count < PERMUTATIONS_MAX:
        raise _fault(element, f"more than {PERMUTATIONS_MAX} steps")
    return [low + index * step for index in range(int(count + _STEP_TOLERANCE) + 1)]


def _range(element: ScenarioElement) -> tuple[float, float]:
    limits = element if element.name == "Range" else element.first("Range")
    if limits is None:
        return -math.inf, math.inf
    low, high = float(limits.values["lowerLimit"]), float(limits.values["upperLimit"])
    if low > high:
        raise _fault(limits, f"lowerLimit {low:g} is above upperLimit {high:g}")
    return low, high


def _stochastic(element: ScenarioElement) -> list[Assignment]:
    """Each parameter has a stream of its own: neither order nor other parameters change it."""
    runs = int(element.values["numberOfTestRuns"])
    if runs > PERMUTATIONS_MAX:
        raise _fault(element, f"numberOfTestRuns is {runs}, at most {PERMUTATIONS_MAX}")
    seed = int(np.float64(element.values.get("randomSeed", 0.0)).view(np.uint64))
    table: list[Assignment] = [{} for _ in range(runs)]
    for child in element.children:
        name = str(child.values["parameterName"])
        if table and name in table[0]:
            raise _fault(child, f"parameter {name} is distributed twice")
        key = stream_key(seed, element.file.name, f"openscenario/{name}")
        for run, assignment in enumerate(table):
            random = np.random.Generator(np.random.Philox(key=[key, run]))
            assignment[name] = _draw(child.children[0], random)
    return table


def _draw(element: ScenarioElement, random: np.random.Generator) -> Value:
    match element.name:
        case "ProbabilityDistributionSet" | "Histogram":
            item = element.children[_weighted(element, random)]
            if element.name == "ProbabilityDistributionSet":
                return item.values["value"]
            low, high = _finite(item)
            return low + (high - low) * float(random.random())
        case "UniformDistribution":
            low, high = _finite(element)
            return low + (high - low) * float(random.random())
    low, high = _range(element)
    for value in _samples(element, random):
        if low <= value <= high:
            return value
    raise _fault(element, f"{_DRAWS_MAX} draws in a row lie outside its range")


def _samples(element: ScenarioElement, random: np.random.Generator) -> Iterator[float]:
    mean = float(element.values["expectedValue"])
    variance = float(element.values.get("variance", 0.0))
    if not (math.isfinite(mean) and 0 <= variance < math.inf):
        raise _fault(element, "expectedValue must be finite and variance 0 or more")
    if element.name != "NormalDistribution" and not 0 < mean < 1e9:
        raise _fault(element, f"expectedValue is {mean:g}, it must be above 0 and below 1e9")
    for _ in range(_DRAWS_MAX):
        if element.name == "PoissonDistribution":
            yield float(random.poisson(mean))
        elif element.name == "LogNormalDistribution":
            spread = math.log1p(variance / mean**2)
            yield float(random.lognormal(math.log(mean) - spread / 2, math.sqrt(spread)))
        else:
            yield float(random.normal(mean, math.sqrt(variance)))


def _weighted(element: ScenarioElement, random: np.random.Generator) -> int:
    weights = [float(item.values["weight"]) for item in element.children]
    if not all(0 <= weight < math.inf for weight in weights) or not 0 < sum(weights) < math.inf:
        raise _fault(element, "weights must be 0 or more, and one of them above 0")
    edges = np.cumsum(weights)
    index = int(np.searchsorted(edges, random.random() * edges[-1], side="right"))
    return min(index, len(weights) - 1)


def _finite(element: ScenarioElement) -> tuple[float, float]:
    low, high = _range(element)
    if not (math.isfinite(low) and math.isfinite(high)):
        raise _fault(element, "its range must be finite")
    return low, high


def _fault(element: ScenarioElement, words: str) -> ValueError:
    return ValueError(f"{element.file}:{element.line}: {element.name}: {words}")
