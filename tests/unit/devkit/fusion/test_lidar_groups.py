"""Cells of a sweep that touch are one group: those that OpenCV finds."""

import cv2
import numpy as np
import pytest

from devkit.fusion.lidar_objects import joined


def spiral(side: int) -> np.ndarray:
    """One group, as long as a group can be."""
    solid = np.zeros((side, side), bool)
    row, column, down, right = 0, 0, 0, 1
    solid[0, 0] = True
    for _ in range(side * side):
        ahead = row + 2 * down, column + 2 * right
        inside = all(0 <= place < side for place in (row + down, column + right))
        taken = all(0 <= place < side for place in ahead) and solid[ahead]
        if not inside or taken:
            down, right = right, -down
            if solid[row + down, column + right]:
                break
            continue
        row, column = row + down, column + right
        solid[row, column] = True
    return solid


GRIDS = {
    "none": np.zeros((5, 7), bool),
    "all": np.ones((5, 7), bool),
    "one cell": np.eye(1, dtype=bool),
    "corners": np.eye(9, dtype=bool) | np.eye(9, dtype=bool)[::-1],
    "stripes": np.arange(48).reshape(6, 8) % 2 == 0,
    "edges": np.pad(np.zeros((4, 6), bool), 1, constant_values=True),
    "spiral": spiral(61),
    **{
        f"{share} of {shape}": np.random.default_rng(7).random(shape) < share
        for shape in ((1, 40), (40, 1), (120, 144))
        for share in (0.01, 0.1, 0.3, 0.41, 0.6)
    },
}


@pytest.mark.parametrize("name", GRIDS)
def test_groups_are_those_of_opencv(name):
    solid = GRIDS[name]
    ours = joined(solid)
    count, theirs = cv2.connectedComponents(solid.astype(np.uint8), connectivity=8)
    pairs = set(zip(ours.ravel().tolist(), theirs.ravel().tolist(), strict=True))
    assert len(pairs) == len(np.unique(theirs)), "one of ours to one of theirs"
    assert len({group for group, _ in pairs}) == len(pairs)
    assert ours.max(initial=0) == count - 1, "numbered without gaps"
    assert ((ours == 0) == ~solid).all()


def test_the_spiral_is_long():
    assert GRIDS["spiral"].sum() > 1500
    assert joined(GRIDS["spiral"]).max() == 1
