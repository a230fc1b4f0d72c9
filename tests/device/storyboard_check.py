"""Storyboards in kernels of one device: the same bytes as on the CPU, whatever the slots.

    PYTHONPATH=tests python tests/device/storyboard_check.py --device cuda:0

Plays 1,000 steps of five programs of 32 actors, one of them with driver models, one with trains and
traffic signals, with 1, 5, 64 and 256 slots on the CPU and on the device, and prints a digest of
each program's states and transitions; where a program's bytes differ, it says at which step and in
which columns they did first. Then it measures a step of 256 slots of 16 actors on the device. Exit
code 1: bytes differ, or the step takes longer than the target.
"""

from __future__ import annotations

import argparse
import hashlib
import sys

import numpy as np
from train_traffic import train_traffic

from twin.bench.storyboard import lines, measure
from twin.bench.storyboard_traffic import driver_traffic, reacting_traffic, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer

ACTORS = 32
PROGRAMS = 5
"""The last one has driver models."""
SLOTS = (1, 5, 64, 256)
STEPS = 1000


def begun_player(device: str, slots: int, first: int = 0) -> StoryboardPlayer:
    """Slots at the beginning of one program after the other, from ``first`` on."""
    programs = [reacting_traffic(ACTORS, variant) for variant in range(PROGRAMS - 2)]
    programs += [driver_traffic(ACTORS), train_traffic(ACTORS)]
    player = StoryboardPlayer(programs, road_tables(ring_network()), slots, device=device)
    for slot in range(slots):
        player.start(slot, (first + slot) % PROGRAMS)
    return player


def digests(device: str, slots: int, steps: int = STEPS) -> dict[int, set[str]]:
    """Digests of the states and transitions of every slot, by program."""
    player = begun_player(device, slots)
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


def first_difference(device: str, program: int, steps: int = STEPS) -> str:
    """Where the states of a program on ``device`` first are not those on the CPU."""
    players = begun_player("cpu", 1, program), begun_player(device, 1, program)
    for step in range(steps):
        for player in players:
            player.step()
        reals = [player.bodies.reals.numpy()[0].view(np.uint64) for player in players]
        wholes = [player.bodies.wholes.numpy()[0] for player in players]
        of_real, of_whole = reals[0] != reals[1], wholes[0] != wholes[1]
        if of_real.any() or of_whole.any():
            columns = [Real(column).name for column in np.flatnonzero(of_real.any(axis=0))]
            columns += [Whole(column).name for column in np.flatnonzero(of_whole.any(axis=0))]
            entities = np.flatnonzero(of_real.any(axis=1) | of_whole.any(axis=1)).tolist()
            return f"step {step}, entities {entities}: {', '.join(columns)}"
    return "nowhere with one slot"


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
    for program, seen in by_program.items():
        if len(seen) > 1 and device != "cpu":
            print(f"program {program} first differs: {first_difference(device, program)}")
    figures = measure(device, demo=False, cameras=False)
    print("\n".join(lines(figures)))
    return int(not same or bool(figures.missed))


if __name__ == "__main__":
    sys.exit(main())
