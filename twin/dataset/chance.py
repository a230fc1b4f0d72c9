"""Random numbers of a dataset: a generator per purpose, so that nothing depends on the order."""

from __future__ import annotations

import numpy as np

from schemas.identity import stream_key


def generator(seed: int, what: str, stream: str) -> np.random.Generator:
    """Random numbers of a dataset for ``what`` (as ``train/17``) and one purpose."""
    return np.random.default_rng(stream_key(seed, what, f"dataset/{stream}"))


def pick(rng: np.random.Generator, weights: dict[str, float]) -> str:
    """One of the names, by weight."""
    names = list(weights)
    edges = np.cumsum([weights[name] for name in names])
    found = int(np.searchsorted(edges, rng.random() * edges[-1], side="right"))
    return names[min(found, len(names) - 1)]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Uniform."""
    return low + (high - low) * float(rng.random())


def scattered(rng: np.random.Generator, sigma: float, limit: float) -> float:
    """Normal with mean 0, kept within ``limit``."""
    return float(np.clip(rng.normal() * sigma, -limit, limit))


def far_and_near(rng: np.random.Generator, low: float, high: float) -> float:
    """Every distance ratio between ``low`` > 0 and ``high`` is as likely."""
    return float(low * (high / low) ** rng.random())
