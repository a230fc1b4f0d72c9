"""A finished campaign of many cases, and how long the console takes to tell of it.

Run as ``python -m viewer.bench.table CASES``; a child of ``viewer bench``: its memory is
that of the console alone. Prints one line of JSON.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from schemas.names import WEATHERS
from schemas.words import counted
from twin.base.process import bind_to_parent, watch_lifeline
from viewer.console.run_folder import RunFolder, find_runs
from viewer.console.site import ConsoleSite

HOURS = 20
WORDS = ("pass", "collision", "false_braking", "pass", "pass")
ADDRESSES = ("runs.json", "runs/bench/run.json", "runs/bench/table.json")
"""What a page asks for before it shows anything, in this order."""


def write_campaign(folder: Path, cases: int) -> int:
    """Write ``campaign.yaml`` and ``outcomes.json`` of a finished campaign that nobody ran.

    Returns:
        Cases that it has: the first full matrix of at least so many.
    """
    per_repeat = len(WEATHERS) * HOURS
    repeats = -(-cases // per_repeat)
    campaign = {
        "schema": 1,
        "campaign": "bench",
        "matrix": {
            "repeat": list(range(repeats)),
            "weather": list(WEATHERS),
            "time_of_day": [f"{hour:02d}:00" for hour in range(4, 4 + HOURS)],
        },
    }
    folder.mkdir()
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    names = RunFolder(folder).points()
    rows = {name: _ended(name, number) for number, name in enumerate(names)}
    text = json.dumps({"campaign": "bench", "complete": True, "cases": rows})
    (folder / "outcomes.json").write_text(text)
    return len(rows)


def _ended(case: str, number: int) -> dict[str, Any]:
    """A case with numbers of its own, so that nothing compresses better than a real one's."""
    value = (number * 2654435761 % 2**32) / 2**32
    scalars = {
        "sim_time_s": 5 + 5 * value,
        "ticks": 100 + number % 100,
        "dtc_min_m": 20 * value,
        "dtc_end_m": 20 * value + 1e-9,
        "aeb_time_s": 4 * value,
        "aeb_dtc_m": 30 * value,
        "impact_speed_mps": 3 * value if number % len(WORDS) == 1 else None,
        "decel_peak_mps2": 8 * value,
        "speed_max_mps": 8 + value,
        "collisions": int(number % len(WORDS) == 1),
        "nearest_min_m": value,
    }
    return {
        "outcome": "verdict",
        "verdict": WORDS[number % len(WORDS)],
        "reasons": [f"came to rest {20 * value:.2f} m from the obstacle"],
        "scalars": scalars,
        "names": {"nearest_object": f"parked car {number % 30}"},
        "attempt_dir": f"cases/{case}/attempt-1",
        "attempt": 1,
        "attempts": 1,
        "worker": f"worker-{number % 64}",
        "wall_s": 8 * value,
        "rig_wall_s": 8 * value,
    }


def measure(cases: int) -> dict[str, Any]:
    """Times of the first and the second answers, size on the line, and memory.

    Processor time is that of the first: it hardly depends on what else a machine does.
    """
    with tempfile.TemporaryDirectory(prefix="viewer-bench-") as folder:
        made = write_campaign(Path(folder, "made"), cases)
        # Plans are remembered by their paths, and the console has not read this one.
        Path(folder, "made").rename(Path(folder, "bench"))
        site = ConsoleSite(find_runs(Path(folder, "bench")), keep=False)
        cpu_s = time.process_time()
        first_s, _ = _asked(site)
        cpu_s = time.process_time() - cpu_s
        again_s, line_bytes = _asked(site)
    return {
        "cases": made,
        "first_s": round(first_s, 3),
        "first_cpu_s": round(cpu_s, 3),
        "again_s": round(again_s, 4),
        "line_kb": round(line_bytes / 1e3, 1),
        "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, 1),
    }


def _asked(site: ConsoleSite) -> tuple[float, int]:
    """Seconds until all of it is there, packed for the line, and its size there."""
    begun_s = time.monotonic()
    answers = [site.answer(address) for address in ADDRESSES]
    size = sum(len(answer.packed) for answer in answers)
    return time.monotonic() - begun_s, size


def line(found: dict[str, Any]) -> str:
    """The measurement for people."""
    return (
        f"console, {counted(found['cases'], 'case')} that have ended: list, campaign and table in "
        f"{found['first_s']} s ({found['first_cpu_s']} s of a processor), again in "
        f"{found['again_s']} s, {found['line_kb']} kB on the line, {found['memory_mb']} MB"
    )


if __name__ == "__main__":
    bind_to_parent()
    watch_lifeline()
    print(json.dumps(measure(int(sys.argv[1]))), flush=True)
