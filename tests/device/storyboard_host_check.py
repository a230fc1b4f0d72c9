"""Storyboards as cases play them, on the CPU and on a device: which is faster, and are bytes equal.

    PYTHONPATH=tests python tests/device/storyboard_host_check.py --device cuda:0

Cases tell the player where the egos are before every step, and need bodies and events on the host
after it. So this measures that whole round trip, which a bench of steps alone leaves out: poses to
the device, a step, states and transitions back. Exit code 1: bytes differ.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import sys
import time

import numpy as np

from twin.bench.storyboard_traffic import driver_traffic, reacting_traffic, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.player.columns import Real

ACTORS = (2, 16)
SLOTS = (1, 8, 64, 256)
STEP_S = 0.01
WARM = 20
STEPS = 300
_POSE = (Real.X, Real.Y, Real.Z, Real.HEADING, Real.PITCH, Real.ROLL, Real.SPEED)


def played(device: str, slots: int, actors: int) -> tuple[float, str]:
    """Milliseconds of a round trip of all slots, and the digest of the last states."""
    programs = [
        *(reacting_traffic(actors, variant) for variant in range(3)),
        driver_traffic(actors),
    ]
    player = RigPlayer(programs[0], road_tables(ring_network()), slots, STEP_S, device)
    for slot in range(slots):
        player.begin(slot, programs[slot % len(programs)], 0)
    led = np.zeros(slots, np.bool_)
    begin = 0.0
    for step in range(WARM + STEPS):
        if step == WARM:
            begin = time.perf_counter()
        egos = np.ascontiguousarray(player.bodies.reals.numpy()[:, 0, _POSE])
        egos[:, 0] += egos[:, 6] * np.cos(egos[:, 3]) * STEP_S
        egos[:, 1] += egos[:, 6] * np.sin(egos[:, 3]) * STEP_S
        player.impose_egos(egos, led)
        player.step()
        reals, wholes = player.bodies.reals.numpy(), player.bodies.wholes.numpy()
        player.now()
    spent_s = time.perf_counter() - begin
    seen = hashlib.sha256(np.ascontiguousarray(reals).tobytes())
    seen.update(np.ascontiguousarray(wholes).tobytes())
    return 1e3 * spent_s / STEPS, seen.hexdigest()[:16]


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    device = parser.parse_args().device
    same = True
    for actors, slots in itertools.product(ACTORS, SLOTS):
        figures = {where: played(where, slots, actors) for where in dict.fromkeys(("cpu", device))}
        same &= len({digest for _, digest in figures.values()}) == 1
        print(
            f"{slots:4} slots x {actors:2} actors: "
            + ", ".join(f"{ms:.3f} ms a step on {where}" for where, (ms, _) in figures.items())
        )
    print("all bytes are equal" if same else "BYTES DIFFER")
    return int(not same)


if __name__ == "__main__":
    sys.exit(main())
