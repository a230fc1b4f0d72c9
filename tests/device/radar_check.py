"""Radar on a GPU: the same bytes as on the CPU, and measurements per second.

``python tests/device/radar_check.py [--device cuda:0] [--slots 256]`` compares the detections of 16
slots of every shipped profile on both devices and times ``--slots`` slots; exit code 1 where bytes
differ or the rate of the long-range radar is below its target.
"""

from __future__ import annotations

import argparse
import sys

from twin.world.kernel_cache import prepare_kernels

prepare_kernels()

from schemas.kinds.sensors.radar import PROFILES  # noqa: E402
from twin.bench import radar as bench  # noqa: E402

COMPARED = 16
"""Slots whose bytes are compared."""


def main() -> int:
    """Print the figures; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--slots", type=int, default=256)
    args = parser.parse_args()
    good = True
    for profile in PROFILES:
        host, other = (bench.measure(d, COMPARED, profile) for d in ("cpu", args.device))
        same = host.digest == other.digest
        good = good and same
        print(f"{profile}: cpu {host.digest[:16]}, {args.device} {other.digest[:16]}, same {same}")
        timed = bench.measure(args.device, args.slots, profile)
        print(f"{profile}: {timed.frames_per_s:,.0f} measurements/s at {args.slots} slots")
        if profile == "long_range" and timed.frames_per_s < timed.target:
            print(f"{profile}: below the target of {timed.target:,.0f}")
            good = False
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
