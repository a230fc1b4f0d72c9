"""twin.vehicle.wall_grid: a cell lists every wall that a vehicle in it can reach."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from twin.vehicle.wall_grid import CELLS_MAX, MARGIN_M, WallGrid, wall_grid, walls_near

EXTENT_M = 3.5


@wp.kernel
def ask_kernel(grid: WallGrid, places: wp.array(dtype=wp.vec2d), found: wp.array(dtype=wp.vec2i)):
    """The walls of every place."""
    i = wp.tid()
    found[i] = walls_near(grid, places[i][0], places[i][1])


def listed(walls: np.ndarray, places: np.ndarray) -> list[list[int]]:
    """What each place's cell lists."""
    grid = wall_grid(walls, EXTENT_M, wp.get_device("cpu"))
    found = wp.zeros(len(places), dtype=wp.vec2i, device="cpu")
    wp.launch(
        ask_kernel,
        len(places),
        [grid, wp.array(places, dtype=wp.vec2d, device="cpu")],
        [found],
        device="cpu",
    )
    order = grid.walls.numpy()
    return [order[a:b].tolist() for a, b in found.numpy()]


@pytest.mark.parametrize("scale_m", [5.0, 80.0, 6000.0])
def test_a_place_finds_every_wall_in_reach_in_ascending_order(scale_m):
    rng = np.random.default_rng(int(scale_m))
    walls = np.column_stack(
        [rng.uniform(-scale_m, scale_m, (300, 2)), np.zeros(300), rng.uniform(0.1, 12.0, (300, 2))]
    )
    places = rng.uniform(-1.3 * scale_m - 40.0, 1.3 * scale_m + 40.0, (2000, 2))
    places[::2] = walls[rng.integers(0, 300, 1000), :2] + rng.uniform(-25.0, 25.0, (1000, 2))
    reach = walls[:, 3] + walls[:, 4] + EXTENT_M + MARGIN_M
    near = (np.abs(places[:, None] - walls[None, :, :2]) < reach[None, :, None]).all(axis=2)
    found = listed(walls, places)
    assert near.any(axis=1).sum() > 500
    for row, cell in zip(near, found, strict=True):
        assert cell == sorted(cell)
        assert set(np.flatnonzero(row)) <= set(cell)
    mean = sum(map(len, found)) / len(found)
    assert mean < 300 * 0.9 or scale_m < 10.0
    grid = wall_grid(walls, EXTENT_M, wp.get_device("cpu"))
    assert max(grid.columns, grid.rows) <= CELLS_MAX


def test_a_world_without_walls():
    assert listed(np.zeros((0, 5)), np.zeros((3, 2))) == [[], [], []]
