"""Roads in kernels of one device: the same bytes as on the CPU.

    PYTHONPATH=tests python tests/device/road_check.py --device cuda:0

Asks every road function about the same 65,536 places of made-up networks on the CPU and on the
device, prints how many rows differ by function and the largest difference, and the time of a step
of 4,096 movers. Exit code 1: bytes differ.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
import warp as wp
from road_networks import composed, junction, shapes, turned
from road_walks import Walks

from twin.road.tables.road_tables import road_tables

NETWORKS = {"shapes": shapes, "turned": turned, "composed": composed, "junction": junction}
COUNT = 65_536
MOVERS = 4096


def rows_of(walks: Walks) -> dict[str, np.ndarray]:
    """What each function says about places, moves, points and pairs of a network."""
    rng = np.random.default_rng(11)
    tables = walks.tables
    road = rng.integers(0, len(tables.road_ids), COUNT)
    s = rng.uniform(0.0, 1.0, COUNT) * tables.extents[road, 0]
    t, way = rng.uniform(-9.0, 9.0, COUNT), rng.uniform(-80.0, 80.0, COUNT)
    lane, other = rng.integers(-3, 4, COUNT), rng.permutation(COUNT)
    pose = walks.pose(road, s, t)
    # Points and hints are the same on both devices.
    x, y = rng.uniform(-40.0, 140.0, COUNT), rng.uniform(-60.0, 60.0, COUNT)
    return {
        "pose": pose,
        "pose along a slope": walks.pose(road, s, t, 0.01 * t),
        "lanes": walks.lanes(road, s, t, lane, 2),
        "advance": np.array(walks.advance(road, -99, s, t, 1, way, 0.3 * way)).T,
        "locate": walks.locate(x, y, np.nan),
        "locate near": walks.locate(x, y, 0.5, road, s),
        "apart": walks.apart(road, s, t, road[other], s[other], t[other]),
    }


def step_us(walks: Walks) -> float:
    """Microseconds of one move of all movers, best of five."""
    s = np.linspace(0.0, 20.0, MOVERS)
    best = np.inf
    for _ in range(6):
        wp.synchronize_device(walks.device)
        begin = time.perf_counter()
        walks.advance(0, -1, s, 0.1, 1, *[0.2] * 20)
        best = min(best, time.perf_counter() - begin)
    return float(best) / 20.0 * 1e6


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    device = parser.parse_args().device
    differing = 0
    for name, network in NETWORKS.items():
        tables = road_tables(network())
        here, there = rows_of(Walks(tables)), rows_of(Walks(tables, device))
        for function, rows in here.items():
            unlike = (rows != there[function]) & ~(np.isnan(rows) & np.isnan(there[function]))
            differing += int(unlike.sum())
            worst = float(np.abs(np.where(unlike, rows - there[function], 0.0)).max())
            print(f"{name:9} {function:20} {int(unlike.any(axis=1).sum())} of {COUNT}, {worst:.1e}")
    for where in ("cpu", device):
        print(
            f"{where}: {step_us(Walks(road_tables(junction()), where)):.1f} us a step of {MOVERS}"
        )
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
