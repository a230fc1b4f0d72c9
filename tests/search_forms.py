"""Limit states with a known probability of failure, and a fast way to search them.

Coordinates are standard normal; a form takes many points at once. ``Form.truth`` is exact, or a
quadrature to 12 digits.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.integrate import quad
from scipy.special import chdtrc, ndtr, ndtri

from conductor.search.protocol import Array, Estimate, History, Problem, Sampler
from schemas.identity import stream_key
from schemas.kinds.registry import implementation
from schemas.kinds.sampler import sampler_kinds


class Form(NamedTuple):
    """A limit state."""

    name: str
    dimension: int
    truth: float
    """Probability of failure."""
    margin: Callable[[Array], Array]
    """Coordinates [points, dimension] -> margins [points], below 0 where a case fails."""


def plane(probability: float, dimension: int) -> Form:
    """A plane with this probability, tilted against all axes."""
    distance, root = -float(ndtri(probability)), np.sqrt(dimension)
    name = f"plane {probability:.3g}, {dimension}"
    return Form(name, dimension, probability, lambda u: distance - np.sum(u, axis=1) / root)


def sphere(probability: float, dimension: int) -> Form:
    """Failures outside of a sphere around the origin: in all directions alike."""
    low, high = 0.0, 20.0
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if _beyond(dimension, middle) > probability else (low, middle)
    radius = low
    name = f"sphere {probability:.3g}, {dimension}"
    truth = _beyond(dimension, radius)
    return Form(name, dimension, truth, lambda u: radius - np.sqrt(np.sum(u * u, axis=1)))


def _beyond(dimension: int, radius: float) -> float:
    return float(chdtrc(dimension, radius * radius))


def four_branches() -> Form:
    """The series system of four branches, two of them bent, in two parameters: with ``s`` and
    ``d`` along the diagonals it holds where abs(d) < 3 and abs(s) < 3 + 0.2 d^2."""

    def margin(u: Array) -> Array:
        s, d = (u[:, 0] + u[:, 1]) / np.sqrt(2.0), (u[:, 0] - u[:, 1]) / np.sqrt(2.0)
        bent = 3.0 + 0.2 * d * d - np.abs(s)
        return np.minimum(bent, np.sqrt(2.0) * (3.0 - np.abs(d)))

    def held(d: float) -> float:
        bell = np.exp(-d * d / 2) / np.sqrt(2 * np.pi)
        return float(bell * (1.0 - 2.0 * ndtr(-3.0 - 0.2 * d * d)))

    holds, _ = quad(held, -3.0, 3.0, epsabs=1e-14, epsrel=1e-13)
    return Form("four branches", 2, 1.0 - holds, margin)


def series(probability: float, dimension: int) -> Form:
    """Three planes at right angles, each as likely as the others, any of which is a failure."""
    single = 1.0 - (1.0 - probability) ** (1 / 3)
    distance, half = -float(ndtri(single)), np.sqrt(0.5)

    def margin(u: Array) -> Array:
        plus, minus = half * (u[:, 0] + u[:, 1]), half * (u[:, 0] - u[:, 1])
        return np.asarray(distance - np.maximum(np.maximum(plus, minus), -u[:, 2]))

    return Form(f"series {probability:.3g}, {dimension}", dimension, probability, margin)


class Settings(NamedTuple):
    """What a form is searched with; the words of the section ``search``."""

    sampler: str
    cases: int
    generation: int = 50
    options: dict[str, Any] = {}  # noqa: RUF012 - never changed
    relative: float | None = None
    """``relative_half_width``: the search ends there."""


class Found(NamedTuple):
    """What a search has found."""

    estimate: Estimate
    cases: int


class Streams:
    """Random numbers by name, keyed as those of a campaign are."""

    def __init__(self, seed: int, campaign: str = "solved") -> None:
        self._seed, self._campaign = seed, campaign

    def __call__(self, name: str) -> np.random.Generator:
        key = stream_key(self._seed, self._campaign, f"search/{name}")
        return np.random.Generator(np.random.Philox(key=[key, 0]))


def steps(dimension: int, settings: Settings, seed: int) -> Generator[Array, Array, Found]:
    """A search by its sampler alone, with the driver's rules of when it ends: yields coordinates
    of generations and is sent their margins.

    One object of the sampler is kept for all steps, and values are not rounded: that is all that
    differs from :func:`search_bench.solve`, and a test compares the two.
    """
    kind = sampler_kinds().find(settings.sampler)
    options = msgspec.convert(settings.options, kind.options)
    repeats = settings.relative is not None
    problem = Problem(dimension, settings.cases, settings.generation, repeats)
    made: Any = implementation(kind.implementation)
    sampler: Sampler = made(options, problem)
    streams, u, g = Streams(seed), list[Array](), list[Array]()
    estimate = Estimate(method="none")
    while True:
        proposed = sampler.propose(History(u, g), streams)
        cases = sum(map(len, g))
        if not len(proposed) or cases + len(proposed) > settings.cases:
            return Found(estimate, cases)
        margins = yield proposed
        u.append(proposed)
        g.append(margins)
        estimate = sampler.answer(History(u, g))
        if estimate.settled or _narrow(settings, estimate):
            return Found(estimate, cases + len(proposed))


def search(form: Form, settings: Settings, seed: int) -> Found:
    """A search on a closed form."""
    going = steps(form.dimension, settings, seed)
    proposed = next(going)
    while True:
        try:
            proposed = going.send(form.margin(proposed))
        except StopIteration as ended:
            found: Found = ended.value
            return found


def _narrow(settings: Settings, estimate: Estimate) -> bool:
    low, high, probability = estimate.low, estimate.high, estimate.probability
    if settings.relative is None or low is None or high is None or not probability:
        return False
    return (high - low) / 2 <= settings.relative * probability
