"""How long a machine that has just been installed from a bundle waits for its first tick.

    PYTHONPATH=tests python tests/device/start_check.py --device cuda:0 --out FOLDER

Compiles kernels as ``hpc bundle --campaign`` does, then runs the campaign with nothing but them:
caches of its own that hold a copy of the bundle's kernels, with ``--without`` also caches that are
empty. As root it lets the system forget the files that it has read before, as after a start. Prints
the seconds from the command to the first tick, and those of a second run in the same caches. Needs
no test runner; ``--device cpu --campaign chaos-16 --workers 1`` is a rehearsal. Exit code 1: a run
with the bundle's kernels compiled some, or its first tick came later than ``--limit-s``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import msgspec

from hpc.software.bundle import compile_kernels
from twin.rig.profile import FOLDER_VARIABLE, LoopProfile

LIMIT_S = 12.0
"""Longest time from the command to the first tick [s]."""
FORGET = Path("/proc/sys/vm/drop_caches")


def compiled(folder: Path) -> set[Path]:
    """Compiled kernels in a cache."""
    files = (path for ending in ("*.o", "*.cubin", "*.ptx") for path in folder.rglob(ending))
    return {path.relative_to(folder) for path in files}


def forget_files() -> bool:
    """Let the system forget what it has read; whether it did."""
    os.sync()
    with contextlib.suppress(OSError):
        FORGET.write_text("3\n")
        return True
    return False


def first_tick_s(options: argparse.Namespace, name: str, caches: Path) -> float:
    """Run the campaign; the time from the command to its first tick [s]."""
    out = options.out / name
    profiles = out / "profiles"
    profiles.mkdir(parents=True)
    variables = {
        **os.environ,
        "WARP_CACHE_PATH": str(caches / "kernels"),
        "XDG_CACHE_HOME": str(caches / "home"),
        FOLDER_VARIABLE: str(profiles),
    }
    words = [sys.executable, "-m", "conductor", "run", options.campaign, "--out", str(out / "run")]
    words += ["--workers", options.workers]
    words += [] if options.cases is None else ["--cases", str(options.cases)]
    begun_s = time.monotonic()
    code = subprocess.run(words, env=variables, check=False).returncode
    if code > 1:
        raise SystemExit(f"{name}: conductor run ended with {code}")
    found = [
        msgspec.json.decode(path.read_bytes(), type=LoopProfile) for path in profiles.glob("*.json")
    ]
    first_s: float = min(profile.first_tick_s for profile in found)
    return first_s - begun_s


def main() -> int:
    """Exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--campaign", default="aeb-256")
    parser.add_argument("--cases", type=int, help="only so many; default: all")
    parser.add_argument("--workers", default="4xcuda")
    parser.add_argument("--without", action="store_true", help="also with caches that are empty")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out = options.out.absolute()
    bundle = options.out / "bundle"
    compile_kernels(options.device, bundle, options.out / "scratch", [options.campaign])
    figures: dict[str, float] = {}
    forgotten = True
    wrong = []
    for name, kernels in (("bundle", bundle), ("nothing", None))[: 1 + options.without]:
        caches = options.out / f"caches-{name}"
        (caches / "kernels").mkdir(parents=True)
        (caches / "home").mkdir()
        if kernels:
            shutil.copytree(kernels, caches / "kernels", dirs_exist_ok=True)
        forgotten = forget_files() and forgotten
        figures[name] = first_tick_s(options, name, caches)
        figures[f"{name}, again"] = first_tick_s(options, f"{name}-again", caches)
        if kernels and (more := compiled(caches / "kernels") - compiled(kernels)):
            wrong.append(f"{len(more)} kernels were compiled, e.g. {min(more)}")
    if figures["bundle"] > options.limit_s:
        wrong.append(f"first tick after {figures['bundle']:.1f} s, allowed are {options.limit_s:g}")
    (options.out / "start_check.json").write_text(json.dumps(figures, indent=1) + "\n")
    for name, spent_s in figures.items():
        print(f"first tick with the kernels of {name}: {spent_s:.1f} s")
    print(f"files that were read before were {'' if forgotten else 'not '}forgotten")
    for line in wrong:
        print(f"wrong: {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
