"""Blocks of the vehicles' kernels grow with the slots, and results do not follow them."""

import numpy as np
import pytest
import warp as wp

from twin.vehicle.fleet import Fleet, threads_of_a_block
from twin.vehicle.vehicle_file import load_vehicle

H200 = 132


@pytest.mark.parametrize(
    ("slots", "threads"),
    [(1, 8), (256, 8), (4_224, 8), (4_225, 16), (8_448, 16), (8_449, 32), (16_384, 32)],
)
def test_a_block_has_a_scheduler_to_itself_as_long_as_that_is_possible(slots, threads):
    assert threads_of_a_block(slots, H200) == threads


def test_a_block_is_a_warp_at_most_and_a_cpu_has_the_smallest():
    assert threads_of_a_block(1_000_000, H200) == 32
    assert threads_of_a_block(1_000_000, 0) == 8


def test_a_fleet_of_a_cpu_needs_no_kernels_of_its_own_for_many_slots():
    fleets = [Fleet([load_vehicle("opencav")], n, wp.get_device("cpu")) for n in (1, 5_000)]
    for fleet in fleets:
        fleet.place(0, 0.0, 20.0, 0.85)
        fleet.commands[0, 0] = (0.0, 0.6, 0.02, 0.0, 1.0)
        fleet.active[0] = 1
        fleet.advance(25)
    assert np.array_equal(fleets[0].state[0], fleets[1].state[0])
    assert fleets[0].state[0, 0, 0] > 0.5
