"""The wall: where tiles stand, and in which colours."""

import numpy as np
import pytest

from viewer.live.mosaic import BACKGROUND, HEIGHT_PX, WIDTH_PX, Grid, MosaicTile, compose


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 7, 12, 50, 64])
def test_every_tile_stands_on_the_wall_and_on_no_other(count):
    covered = np.zeros((HEIGHT_PX, WIDTH_PX), int)
    grid = Grid(count)
    for x, y, width, height in grid.boxes_px():
        assert x >= 0
        assert y >= 0
        assert x + width <= WIDTH_PX
        assert y + height + grid.label_px <= HEIGHT_PX
        covered[y : y + height + grid.label_px, x : x + width] += 1
    assert covered.max() == 1


@pytest.mark.parametrize("ended", [False, True])
def test_names_have_the_colour_that_was_asked_for(ended):
    """Colours are RGB, the picture is BGR."""
    tile = MosaicTile(None, "HHHH", (250, 120, 10), ended=ended)
    wall = compose([tile]).astype(int)
    coloured = wall[(wall != BACKGROUND).any(axis=-1)]
    ink = coloured[np.abs(coloured - (10, 120, 250)).sum(axis=-1).argmin()]
    assert np.abs(ink - (10, 120, 250)).max() <= 20
