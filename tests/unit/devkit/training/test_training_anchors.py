"""Anchors by k-means: groups of boxes are found, and nothing depends on luck."""

from __future__ import annotations

import numpy as np
import pytest

from devkit.training.anchors import fit_anchors, shape_overlaps


def groups(seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    centres = np.array([[8, 6], [10, 30], [60, 40]])
    return np.concatenate([c * rng.uniform(0.95, 1.05, (200, 2)) for c in centres])


def test_groups_are_found_by_rising_area():
    found = fit_anchors(groups(), 3, seed=1)
    assert found == pytest.approx(np.array([[8, 6], [10, 30], [60, 40]]), rel=0.02)


def test_the_seed_decides():
    boxes = np.random.default_rng(3).uniform(5, 90, (500, 2))
    assert np.array_equal(fit_anchors(boxes, 5, 1), fit_anchors(boxes, 5, 1))


def test_more_anchors_fit_better():
    boxes = np.random.default_rng(3).uniform(5, 90, (500, 2))
    fits = [shape_overlaps(boxes, fit_anchors(boxes, k, 1)).max(axis=1).mean() for k in (1, 3, 9)]
    assert fits[0] < fits[1] < fits[2]


def test_fewer_kinds_of_boxes_than_anchors():
    found = fit_anchors(np.array([[10.0, 20.0]] * 4), 3, 1)
    assert found.tolist() == [[10.0, 20.0]] * 3


def test_large_sets_are_sampled_the_same_way_every_time():
    boxes = np.random.default_rng(3).uniform(5, 90, (30_000, 2))
    assert np.array_equal(fit_anchors(boxes, 2, 1), fit_anchors(boxes, 2, 1))


def test_shape_overlap_by_hand():
    found = shape_overlaps(np.array([[10.0, 10.0]]), np.array([[10.0, 10.0], [5.0, 10.0]]))
    assert found.tolist() == [[1.0, 0.5]]
