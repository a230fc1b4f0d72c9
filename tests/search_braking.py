"""How often intervals cover the probability that a car on a wet road does not stop in time.

``PYTHONPATH=tests python tests/search_braking.py [--seeds 100] [--device cuda:0]``. The limit state
is the vehicle model itself: full pedal after a latency, thousands of cars side by side, each with
its friction, speed, latency and distance to what it must not touch.

The truth is no search's: the braking distances of a grid of cars, at Gauss-Legendre nodes of
friction and speed and at five latencies, and for the distance, which only shifts the limit, the
normal distribution's own integral. A coarser grid says how far the truth may be off. Beside it
stands the closed form ``v t + v^2 / (2 mu g)``.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import numpy as np
import warp as wp
from scipy.special import ndtr
from search_bench import section
from search_forms import Found, Settings, steps

from conductor.search.protocol import Array
from conductor.search.space import values_of
from schemas.sections.search import Search
from twin.vehicle.fleet import Fleet
from twin.vehicle.model import GRAVITY_MPS2, PHYSICS_STEP_NS
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle

STEP_S = PHYSICS_STEP_NS / 1e9
FRICTION = (0.35, 0.55)
SPEED_MPS = (10.0, 13.0, 1.2, 17.0)
"""Lowest, mean, standard deviation, highest."""
LATENCY_STEPS = (50, 250)
"""Physics steps before the pedal: 0.1 to 0.5 s."""
DISTANCE_M = (44.0, 4.0)
"""Mean and standard deviation."""
SLOTS = 2048
LAUNCH_STEPS = 100
"""Physics steps between two looks at who stands."""
SETTINGS = Settings("importance", 1500, 250)


class Truth(NamedTuple):
    """The probability, and what it is compared with."""

    probability: float
    coarse: float
    """By the coarser grid."""
    closed: float
    """By the closed form in place of the vehicle."""
    cars: int
    """Cars that stopped for it."""


class BrakingRoad:
    """Cars that brake."""

    def __init__(self, device: str, slots: int = SLOTS) -> None:
        self._fleet = Fleet([load_vehicle("opencav")], slots, wp.get_device(device))

    def distances_m(self, friction: Array, speed_mps: Array, latency: Array) -> Array:
        """Braking distances [cars]; ``latency`` in physics steps."""
        count = self._fleet.slots
        parts = [
            self._stopped(friction[at : at + count], speed_mps[at : at + count], late)
            for at in range(0, len(friction), count)
            for late in [latency[at : at + count].astype(np.int32)]
        ]
        return np.concatenate(parts)

    def _stopped(self, friction: Array, speed_mps: Array, latency: Array) -> Array:
        fleet, count = self._fleet, len(friction)
        fleet.active[...] = 0
        for slot in range(count):
            fleet.place(slot, 0.0, float(speed_mps[slot]), float(friction[slot]), refresh=False)
        fleet.commands[:count, 0, 0] = (0.0, 0.0, 0.0, 0.0, 1.0)
        fleet.commands[:count, 0, 1] = (0.0, 1.0, 0.0, 0.0, 1.0)
        fleet.active[:count] = 1
        fleet.refresh()
        done = 0
        while fleet.active.any():
            fleet.first_step[...] = done
            fleet.switch_step[:count] = np.maximum(latency - done, 0)
            fleet.advance(LAUNCH_STEPS)
            done += LAUNCH_STEPS
            fleet.active[:count] = fleet.state[:count, 0, COLUMN["held"]] == 0.0
            assert done * STEP_S < 60.0, "a car does not stop"
        return fleet.state[:count, 0, COLUMN["x_m"]].copy()


def closed_m(friction: Array, speed_mps: Array, latency: Array) -> Array:
    """``v t + v^2 / (2 mu g)``."""
    slide = speed_mps * speed_mps / (2 * friction * GRAVITY_MPS2)
    return np.asarray(speed_mps * latency * STEP_S + slide)


def searched_section() -> Search:
    """The distributions, as a campaign would have them."""
    low, mean, sd, high = SPEED_MPS
    speed = {"distribution": "truncated_normal", "mean": mean, "sd": sd, "low": low, "high": high}
    parameters = {
        "friction": {"distribution": "uniform", "low": FRICTION[0], "high": FRICTION[1]},
        "speed_mps": speed,
        "latency": {"distribution": "integers", "low": LATENCY_STEPS[0], "high": LATENCY_STEPS[1]},
        "distance_m": {"distribution": "normal", "mean": DISTANCE_M[0], "sd": DISTANCE_M[1]},
    }
    return msgspec.convert(section(parameters=parameters), Search)


def truth(road: BrakingRoad, nodes: int = 24) -> Truth:
    """The probability that a car stops too late."""
    fine, closed = _by_grid(road, nodes)
    coarse, _ = _by_grid(road, nodes * 2 // 3)
    return Truth(fine, coarse, closed, 5 * (nodes**2 + (nodes * 2 // 3) ** 2))


def _by_grid(road: BrakingRoad, nodes: int) -> tuple[float, float]:
    """Probability by ``nodes`` x ``nodes`` x 5 cars, and by the closed form at the same nodes."""
    at, weights = np.polynomial.legendre.leggauss(nodes)
    friction = FRICTION[0] + (FRICTION[1] - FRICTION[0]) * (at + 1) / 2
    low, mean, sd, high = SPEED_MPS
    speed = low + (high - low) * (at + 1) / 2
    density = weights * np.exp(-0.5 * ((speed - mean) / sd) ** 2)
    latency = np.linspace(*LATENCY_STEPS, 5)
    f, v, t = (part.ravel() for part in np.meshgrid(friction, speed, latency, indexing="ij"))
    every = np.arange(LATENCY_STEPS[0], LATENCY_STEPS[1] + 1)
    bend = np.array([np.polyfit(latency, row, 4) for row in np.eye(5)])
    between = np.array([np.polyval(row, every) for row in bend])  # [5, latencies]
    found = []
    for distances in (road.distances_m(f, v, t), closed_m(f, v, t)):
        whole = distances.reshape(nodes, nodes, 5) @ between
        failed = np.mean(ndtr((whole - DISTANCE_M[0]) / DISTANCE_M[1]), axis=2)
        found.append(float(weights / 2 @ failed @ (density / np.sum(density))))
    return found[0], found[1]


def run(road: BrakingRoad, settings: Settings, seeds: range) -> list[Found]:
    """Searches of all seeds, generation by generation, their cars side by side."""
    drawn = searched_section()
    going = {seed: steps(len(drawn.parameters), settings, seed) for seed in seeds}
    proposed = {seed: next(search) for seed, search in going.items()}
    ended: dict[int, Found] = {}
    while proposed:
        values = np.array(values_of(drawn, np.concatenate(list(proposed.values()))), np.float64)
        margins = values[:, 3] - road.distances_m(values[:, 0], values[:, 1], values[:, 2])
        for seed, part in zip(list(proposed), _split(margins, proposed), strict=True):
            try:
                proposed[seed] = going[seed].send(part)
            except StopIteration as stop:
                ended[seed] = stop.value
                del proposed[seed]
    return [ended[seed] for seed in seeds]


def _split(margins: Array, proposed: dict[int, Array]) -> Iterator[Array]:
    ends = list(itertools.accumulate(map(len, proposed.values())))
    return iter(np.split(margins, ends[:-1]))


def main() -> None:
    """Print truth and coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--truth", action="store_true", help="the truth alone")
    parser.add_argument("--cases", type=int, default=SETTINGS.cases)
    parser.add_argument("--generation", type=int, default=SETTINGS.generation)
    given = parser.parse_args()
    wp.config.quiet = True
    road = BrakingRoad(given.device)
    right = truth(road)
    print(
        f"truth {right.probability:.6g} by {right.cars} cars, coarser grid {right.coarse:.6g}, "
        f"closed form {right.closed:.6g}",
        flush=True,
    )
    if given.truth:
        return
    settings = SETTINGS._replace(cases=given.cases, generation=given.generation)
    found = run(road, settings, range(given.seeds))
    estimates = [answer.estimate for answer in found]
    told = [e for e in estimates if e.low is not None and e.high is not None]
    covers = sum((e.low or 0.0) <= right.probability <= (e.high or 1.0) for e in told)
    ratio = np.array([e.probability for e in told], np.float64) / right.probability
    none = given.seeds - len(told)
    print(
        f"{settings.sampler}: covers {covers} of {given.seeds}, no interval {none}, "
        f"mean {np.mean(ratio):.3f}, relative error {np.sqrt(np.mean((ratio - 1) ** 2)):.3f}, "
        f"cases {np.mean([answer.cases for answer in found]):.0f}"
    )


if __name__ == "__main__":
    main()
