"""Anchor boxes by k-means with the overlap as distance (Redmon, Farhadi: YOLO9000, 2016, sec. 2).

Boxes are compared by shape alone, as if they shared their centre; the distance of a box to an
anchor is 1 - IoU.
"""

from __future__ import annotations

import numpy as np

RESTARTS = 8
"""Beginnings of which the best end is taken."""

ITERATIONS_MAX = 200

SAMPLE_MAX = 20_000
"""Boxes that are looked at; more change nothing but the time."""

DECIMALS = 2
"""Decimals of an anchor [px]."""


def shape_overlaps(size: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """IoU of sizes [M, 2] with anchors [K, 2] at the same centre -> [M, K]."""
    shared = np.minimum(size[:, None], anchors[None]).prod(axis=2)
    union = size.prod(axis=1)[:, None] + anchors.prod(axis=1)[None] - shared
    overlap: np.ndarray = shared / union
    return overlap


def fit_anchors(size_px: np.ndarray, count: int, seed: int) -> np.ndarray:
    """The anchors that boxes overlap best on average, by rising area.

    Args:
        size_px: float64 [M, 2]: widths and heights of at least one box.
        count: K of them.
        seed: of the beginnings.

    Returns:
        float64 [K, 2], rounded to :data:`DECIMALS`.
    """
    rng = np.random.default_rng(seed)
    if len(size_px) > SAMPLE_MAX:
        size_px = size_px[rng.choice(len(size_px), SAMPLE_MAX, replace=False)]
    # Fewer kinds of boxes than anchors: the anchors that are left over repeat the others.
    best, best_score = np.empty((0, 2)), -1.0
    for _ in range(RESTARTS):
        anchors = _descend(size_px, _spread(size_px, count, rng))
        score = float(shape_overlaps(size_px, anchors).max(axis=1).mean())
        if score > best_score:
            best, best_score = anchors, score
    order = np.lexsort((best[:, 0], best.prod(axis=1)))
    rounded: np.ndarray = np.maximum(np.round(best[order], DECIMALS), 10.0**-DECIMALS)
    return rounded


def _spread(size_px: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Beginnings far from each other (k-means++, Arthur and Vassilvitskii, 2007)."""
    chosen = [size_px[rng.integers(len(size_px))]]
    for _ in range(count - 1):
        distance = 1.0 - shape_overlaps(size_px, np.array(chosen)).max(axis=1)
        edges = np.cumsum(distance**2)
        at = np.searchsorted(edges, rng.random() * edges[-1], side="right")
        chosen.append(size_px[min(int(at), len(size_px) - 1)])
    return np.array(chosen)


def _descend(size_px: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    for _ in range(ITERATIONS_MAX):
        nearest = shape_overlaps(size_px, anchors).argmax(axis=1)
        # The median resists the few very large boxes better than the mean.
        moved = np.array(
            [
                np.median(size_px[nearest == k], axis=0) if (nearest == k).any() else anchors[k]
                for k in range(len(anchors))
            ]
        )
        if np.array_equal(moved, anchors):
            break
        anchors = moved
    return anchors
