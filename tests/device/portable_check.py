"""Compares the bytes of the portable functions on the CPU and on a GPU; needs no test runner.

    PYTHONPATH=tests python tests/device/portable_check.py --device cuda:0 [--out FOLDER]

Every function gets the same 1,048,576 arguments on both; a row per function says how many results
differ in any bit. Exit code 1: some do. Without that device one line says so, and the exit code is
0, since nothing was compared.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from portable_kernels import COUNT, differing


def main() -> None:
    """Compare all functions and print a row of each."""
    from twin.world.kernel_cache import prepare_kernels

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--count", type=int, default=COUNT, help="arguments per function")
    parser.add_argument("--out", type=Path, help="folder that gets portable_check.json")
    options = parser.parse_args()
    prepare_kernels()
    import warp as wp

    if options.device not in [device.alias for device in wp.get_devices()]:
        print(f"skipped: there is no {options.device}; bytes were not compared")
        return
    counts = differing(options.device, options.count)
    for name, count in counts.items():
        print(f"{name:12} {count:8} of {options.count} differ")
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "portable_check.json").write_text(json.dumps(counts, indent=1))
    sys.exit(1 if any(counts.values()) else 0)


if __name__ == "__main__":
    main()
