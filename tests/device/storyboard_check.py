"""Storyboards in kernels of one device: the same bytes as on the CPU, whatever the slots.

    PYTHONPATH=tests python tests/device/storyboard_check.py --device cuda:0

Plays 1,000 steps of three programs of 32 actors, one with trains and traffic signals, in 1, 5, 64
and 256 slots on the CPU and on the device, and prints a digest of each program's states and
transitions; driver models must be refused on a GPU, where their results do not repeat. Then it
measures a step of 256 slots of 16 actors on the device. Exit code 1: bytes differ, or the step
takes longer than the target.
"""

from __future__ import annotations

import argparse
import hashlib
import sys

import numpy as np
from train_traffic import train_traffic

from twin.base.errors import UsageError
from twin.bench.storyboard import lines, measure
from twin.bench.storyboard_traffic import driver_traffic, reacting_traffic, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer

ACTORS = 32
PROGRAMS = 3
SLOTS = (1, 5, 64, 256)
STEPS = 1000


def digests(device: str, slots: int, steps: int = STEPS) -> dict[int, set[str]]:
    """Digests of the states and transitions of every slot, by program."""
    programs = [reacting_traffic(ACTORS, variant) for variant in range(PROGRAMS - 1)]
    programs.append(train_traffic(ACTORS))
    player = StoryboardPlayer(programs, road_tables(ring_network()), slots, device=device)
    for slot in range(slots):
        player.start(slot, slot % PROGRAMS)
    for _ in range(steps):
        player.step()
    reals, wholes = player.bodies.reals.numpy(), player.bodies.wholes.numpy()
    digest_of: dict[int, set[str]] = {}
    for slot in range(slots):
        seen = hashlib.sha256(np.ascontiguousarray(reals[slot]).tobytes())
        seen.update(np.ascontiguousarray(wholes[slot]).tobytes())
        seen.update(repr(player.transitions(slot)).encode())
        digest_of.setdefault(slot % PROGRAMS, set()).add(seen.hexdigest()[:16])
    return digest_of


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    device = parser.parse_args().device
    by_program: dict[int, set[str]] = {}
    for where in dict.fromkeys(("cpu", device)):
        for slots in SLOTS:
            for program, seen in digests(where, slots).items():
                print(f"{where:7} {slots:4} slots, program {program}: {' '.join(sorted(seen))}")
                by_program.setdefault(program, set()).update(seen)
    same = all(len(seen) == 1 for seen in by_program.values())
    print("all bytes are equal" if same else "BYTES DIFFER")
    if device != "cpu":
        try:
            StoryboardPlayer(
                [driver_traffic(ACTORS)], road_tables(ring_network()), 1, device=device
            )
        except UsageError as error:
            print(error)
        else:
            print("DRIVER MODELS ARE NOT REFUSED")
            same = False
    figures = measure(device, demo=False)
    print("\n".join(lines(figures)))
    return int(not same or bool(figures.missed))


if __name__ == "__main__":
    sys.exit(main())
