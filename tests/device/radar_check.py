"""Radar on a GPU: the same bytes as on the CPU, and measurements per second.

``python tests/device/radar_check.py [--device cuda:0] [--slots 256]`` compares the detections of
the first eight of ``--slots`` slots of every shipped profile on both devices. Where they differ it
says in which arrays of the sensor they do, in the order in which these are made. Then it times all
slots and says how long each kernel takes. Exit code 1 where bytes differ or the rate of the
long-range radar is below its target. Cubes of the same eight slots are compared, too, and timed.
About half a minute, half of it compiling.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from typing import Any

from twin.world.kernel_cache import prepare_kernels

prepare_kernels()

import numpy as np  # noqa: E402
import warp as wp  # noqa: E402

from schemas.kinds.sensors.radar import PROFILES  # noqa: E402
from twin.bench.radar import TARGET, RadarBench  # noqa: E402
from twin.sensors.radar_cube.cube import RadarCubes  # noqa: E402

COMPARED = 8
"""Slots whose bytes are compared."""

MADE = ("_poses", "_walls", "echoes", "touched", "signals", "power", "alarm", "_near", "_by_speed")
"""Arrays of a sensor with the slots in front, in the order in which kernels write them."""


def differences(host: RadarBench, other: RadarBench) -> list[str]:
    """What differs in the arrays of two sensors after the same measurement."""
    lines = []
    for name in (*MADE, "_peaks", "found"):
        one, two = (_fields(getattr(bench.sensor, name), bench.slots) for bench in (host, other))
        for field, mine in one.items():
            theirs = two[field][:COMPARED]
            unequal = mine != theirs
            count = int(unequal.sum())
            if count:
                at = tuple(int(i[0]) for i in np.nonzero(unequal))
                lines.append(
                    f"  {name}{field}: {count:,} of {mine.size:,} differ, first at {at}: "
                    f"{mine[at]!r} and {theirs[at]!r}"
                )
    return lines


def _fields(array: Any, slots: int) -> dict[str, np.ndarray]:
    """Columns of an array by name, each [slots, ...]."""
    values = array.numpy()
    names = values.dtype.names
    columns = {f".{n}": values[n] for n in names} if names else {"": values}
    return {name: column.reshape(slots, -1) for name, column in columns.items()}


def cubes(profile: str, device: str) -> tuple[str, float]:
    """SHA-256 of the cubes of the compared slots, and how long they take together [ms]."""
    bench = RadarBench(device, COMPARED, profile)
    bench.detections(COMPARED)
    cube, spent_s = RadarCubes(COMPARED, bench.device), []
    for _ in range(3):
        wp.synchronize_device(bench.device)
        started = time.perf_counter()
        cube.clear()
        cube.take(bench.sensor)
        wp.synchronize_device(bench.device)
        spent_s.append(time.perf_counter() - started)
    return hashlib.sha256(cube.cube.pull().tobytes()).hexdigest(), 1e3 * min(spent_s)


def main() -> int:
    """Print the figures; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--slots", type=int, default=256)
    parser.add_argument("--profile", action="append", help="Of all shipped ones by default.")
    args = parser.parse_args()
    good, started = True, time.perf_counter()
    for profile in args.profile or PROFILES:
        reference = RadarBench("cpu", COMPARED, profile)
        host, _ = reference.detections(COMPARED)
        bench = RadarBench(args.device, args.slots, profile)
        other, _ = bench.detections(COMPARED)
        good = good and host == other
        same = "the same bytes" if host == other else "OTHER BYTES"
        print(f"{profile}: cpu {host[:16]}, {args.device} {other[:16]}: {same}", flush=True)
        if host != other:
            print("\n".join(differences(reference, bench)), flush=True)
        (mine, _), (theirs, took_ms) = (cubes(profile, d) for d in ("cpu", args.device))
        good = good and mine == theirs
        same = "the same bytes" if mine == theirs else "OTHER BYTES"
        print(f"{profile}: cubes {same}, {took_ms:.1f} ms for {COMPARED} slots", flush=True)
        rate, target = bench.rate(), TARGET[args.device.partition(":")[0]]
        print(f"{profile}: {rate:,.0f} measurements/s at {args.slots} slots", flush=True)
        if profile == PROFILES[0]:
            if rate < target:
                print(f"{profile}: below the target of {target:,.0f}")
                good = False
            for name, milliseconds in bench.kernel_times():
                print(f"{milliseconds:10.3f} ms  {name}")
    print(f"{time.perf_counter() - started:.0f} s in all")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
