"""Bytes of everything that computes, on one device, and where they differ from another's.

    PYTHONPATH=tests python tests/device/bytes_check.py --device cpu --out cpu
    PYTHONPATH=tests python tests/device/bytes_check.py --device cuda:0 --out gpu --against cpu

Parts, in this order (``--parts``): ``tables``: what NumPy prepares on the host. ``division``: the
division by hand of rays. ``vehicle``: a million random states of vehicles. ``lidar``, ``radar``:
millions of rays of every shipped profile in rain and fog, from a moving car. ``pictures``: a
hundred pictures of every effect of cameras, of lenses and of materials from files. ``campaigns``:
short runs of shipped campaigns without networks. Writes ``FOLDER/bytes.json``, digests by name, and
``FOLDER/samples.npz``, some of the arrays; ``--against FOLDER`` compares with those of another run
and says which differ and by how much. About two minutes. Exit code 1: bytes differ.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from twin.world.kernel_cache import prepare_kernels

prepare_kernels()

import warp as wp  # noqa: E402
from byte_parts.campaigns import campaigns  # noqa: E402
from byte_parts.pictures import pictures  # noqa: E402
from byte_parts.rays import lidar, radar  # noqa: E402
from byte_parts.tables import tables  # noqa: E402
from byte_parts.vehicles import division, vehicle  # noqa: E402

from twin.base.software import device_class  # noqa: E402

PARTS: dict[str, Callable[[Bytes], None]] = {
    part.__name__: part for part in (tables, division, vehicle, lidar, radar, pictures, campaigns)
}


class Bytes:
    """What was found on a device so far."""

    def __init__(self, device: str, out: Path, share: float) -> None:
        self.device, self.out, self.share = device, out, share
        self.digests: dict[str, str] = {}
        self.samples: dict[str, np.ndarray] = {}

    def count(self, full: int) -> int:
        """That many of the usual number, at least one."""
        return max(1, round(self.share * full))

    def add(self, name: str, *arrays: np.ndarray, sample: np.ndarray | None = None) -> None:
        """Digest arrays under a name; ``sample``: a part of them, to compare numbers."""
        digest = hashlib.sha256()
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        self.say(name, digest.hexdigest())
        if sample is not None:
            self.samples[name] = np.ascontiguousarray(sample)

    def say(self, name: str, digest: str) -> None:
        """A digest that somebody else made."""
        self.digests[name] = digest
        print(f"  {digest[:16]}  {name}", flush=True)

    def read(self) -> None:
        """What an earlier run wrote."""
        self.digests = json.loads((self.out / "bytes.json").read_text())["digests"]
        with np.load(self.out / "samples.npz") as samples:
            self.samples = dict(samples)

    def write(self) -> None:
        """Write everything so far."""
        self.out.mkdir(parents=True, exist_ok=True)
        told = {"device": device_class(self.device), "share": self.share, "digests": self.digests}
        (self.out / "bytes.json").write_text(json.dumps(told, indent=1) + "\n")
        np.savez_compressed(self.out / "samples.npz", **self.samples)  # type: ignore[arg-type]


def compare(found: Bytes, folder: Path) -> int:
    """Print which digests differ from those of another run, and by how much; how many differ."""
    told = json.loads((folder / "bytes.json").read_text())
    other, differing = told["digests"], 0
    common = [name for name in found.digests if name in other]
    with np.load(folder / "samples.npz") as samples:
        for name in common:
            if found.digests[name] == other[name]:
                continue
            differing += 1
            said = "no sample"
            if name in found.samples and name in samples:
                said = difference(found.samples[name], samples[name])
            print(f"DIFFERS: {name}: {said}")
    left = len(found.digests) - len(common)
    print(f"{len(common) - differing} of {len(common)} have the bytes of {told['device']}"
          + (f"; {left} are not there" if left else ""))  # fmt: skip
    return differing


def difference(mine: np.ndarray, theirs: np.ndarray) -> str:
    """How two arrays differ, in words."""
    if mine.shape != theirs.shape or mine.dtype != theirs.dtype:
        return f"{mine.dtype}{mine.shape} and {theirs.dtype}{theirs.shape}"
    size = mine.dtype.itemsize
    bits = [np.ascontiguousarray(a).reshape(-1).view(np.uint8).reshape(-1, size) for a in
            (mine, theirs)]  # fmt: skip
    unequal = (bits[0] != bits[1]).any(axis=1)
    count = int(unequal.sum())
    if not count:
        return f"none of {mine.size:,} values of the sample"
    a, b = (x.reshape(-1)[unequal].astype(np.float64) for x in (mine, theirs))
    with np.errstate(invalid="ignore"):
        off = np.abs(a - b)
    first = int(np.argmax(unequal))
    at = tuple(int(i) for i in np.unravel_index(first, mine.shape))
    return (
        f"{count:,} of {mine.size:,} values of the sample, by {np.nanmax(off, initial=0.0):.3g} at "
        f"most, {np.nanmedian(off):.3g} in the median; first at {at}: {a[0]!r} and {b[0]!r}"
    )


def main() -> int:
    """Print the digests; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--against", type=Path, help="FOLDER of another run.")
    parser.add_argument(
        "--parts", default=",".join(PARTS), help="Empty: compare what is in --out already."
    )
    parser.add_argument("--share", type=float, default=1.0, help="Of everything, to rehearse.")
    options = parser.parse_args()
    found = Bytes(options.device, options.out, options.share)
    wp.init()
    if not options.parts:
        found.read()
    for name in filter(None, options.parts.split(",")):
        started = time.perf_counter()
        print(f"{name}:", flush=True)
        PARTS[name](found)
        print(f"{name}: {time.perf_counter() - started:.1f} s", flush=True)
        found.write()
    return 1 if options.against and compare(found, options.against) else 0


if __name__ == "__main__":
    sys.exit(main())
