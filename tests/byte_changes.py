"""Random changes of one byte in the files of a finished run: how many does `verify` miss?

``python tests/byte_changes.py RUN --count 1000`` changes and restores bytes of a copy of RUN.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
from pathlib import Path

from conductor.trust.signing import trusted_keys
from conductor.trust.verify import verify_run


def missed(folder: Path, count: int, seed: int) -> list[str]:
    """Change ``count`` bytes, one at a time, each in a file drawn evenly; those not noticed."""
    draw = random.Random(seed)
    trusted = trusted_keys()
    assert not verify_run(folder, trusted).differences, "give a run that fits"
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.stat().st_size)
    found = []
    for _ in range(count):
        path = draw.choice(files)
        data = path.read_bytes()
        at, flip = draw.randrange(len(data)), draw.randrange(1, 256)
        path.write_bytes(data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :])
        if not verify_run(folder, trusted).differences:
            found.append(f"{path.relative_to(folder)}, byte {at}: {data[at]} to {data[at] ^ flip}")
        path.write_bytes(data)
    return found


def main() -> int:
    """Print what was missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copytree(given.run, Path(folder) / "run"))
        found = missed(copy, given.count, given.seed)
    print("\n".join([*found, f"{len(found)} of {given.count} changes missed, seed {given.seed}"]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
