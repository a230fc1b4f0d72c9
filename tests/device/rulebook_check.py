"""Checks and measures whole rulebooks on one device in one call; needs no test runner.

    PYTHONPATH=tests python tests/device/rulebook_check.py --device cuda:0 --out FOLDER

Runs the Euro NCAP campaign with the reference stack, two cameras at 640x360 and a LiDAR: first a
few rows, so that kernels are compiled, then all rows with one, two and four workers on the GPU, and
with two workers of an odd number of slots. Of each run it prints the time from command to page
against the limit, the number of rigs that the cases need and of simulators that were started for
them, where the time went, and the fingerprint. ``--runs`` chooses some of them, ``--rows`` some of
the rows, ``--campaigns`` other campaigns. Writes ``FOLDER/rulebook_check.json`` after every run.
Exit code 1: fingerprints of a campaign differ, or its cases need more than one rig per road, or a
time is above the limit.

``--quick`` is a rehearsal on a CPU: small pictures, the easiest and the hardest point of each row.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from conductor.run.places import gpu_slots
from conductor.run.source import find, load, of_rows
from schemas.files.yaml_file import load_yaml
from schemas.identity import rig_key
from schemas.plan import Plan
from twin.bench.campaign import Request, SlotsRow, measure
from twin.rig.profile import LoopProfile

LIMIT_S = 180.0
"""Longest time from command to page, all campaigns together [s]."""
SIZE_PX = (640, 360)
QUICK_PX = (96, 54)
CAMPAIGNS = "euro-ncap-2026"
WARM_ROWS = "ccrs-50,cpna-50,cpla-night"
"""Rows whose cases have a car, a person by day and one by night: all kernels."""
REHEARSED_SLOTS = 8
ODD_SLOTS = 37


@dataclass(frozen=True, slots=True)
class Way:
    """A way to run a campaign."""

    name: str
    workers: int
    slots: int | None = None
    """Slots of each worker; None: those that `conductor run` chooses."""
    counts: bool = True
    """Whether its time is held against the limit."""


WAYS = (Way("four", 4), Way("two", 2), Way("one", 1), Way("odd", 2, ODD_SLOTS, counts=False))


class RulebookCheck:
    """Options, the figures so far, and what does not hold."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.device: str = options.device
        self.out: Path = options.out
        self.quick: bool = options.quick
        self.rows: str = options.rows
        self.figures: dict[str, Any] = {"device": options.device, "runs": {}}
        self.wrong: list[str] = []

    def expect(self, what: str, *, holds: bool) -> None:
        """Note what does not hold."""
        if not holds:
            self.wrong.append(what)
            print(f"WRONG: {what}", flush=True)

    def write(self) -> None:
        """Write the figures so far."""
        text = json.dumps({**self.figures, "wrong": self.wrong}, indent=1)
        (self.out / "rulebook_check.json").write_text(text)

    def campaign_file(self, name: str) -> Path:
        """A file of the campaign with the sensors that are asked for."""
        data = load_yaml(find(name))
        width, height = QUICK_PX if self.quick else SIZE_PX
        camera = data["camera"] | {"name": "front_left", "width": width, "height": height}
        data["camera"] = camera
        data["cameras"] = [camera | {"name": "front_right"}]
        data["lidars"] = [] if self.quick else [{"name": "roof"}]
        path = self.out / f"{Path(name).stem}.yaml"
        path.write_text(json.dumps(data))  # JSON is YAML
        return path

    def run(self, campaign: Path, way: Way, rows: str = "", *, quick: bool = False) -> SlotsRow:
        """One run by `conductor run`, with its figures printed and noted."""
        quick = quick or self.quick
        plan = of_rows(load(campaign), rows, quick=quick)
        name = f"{campaign.stem}-{way.name}"
        options = [*(("--rows", rows) if rows else ()), *(("--quick",) if quick else ())]
        gpu = self.device != "cpu"
        workers = f"{way.workers}xcuda" if gpu else str(way.workers)
        slots = way.slots or gpu_slots(len(plan.cases), way.workers, None)
        slots = slots if gpu else min(slots, REHEARSED_SLOTS)
        request = Request(
            str(campaign), self.device, self.out / "runs" / name, None, workers, tuple(options)
        )
        begun_s = time.monotonic()
        row = measure(request, slots)
        profiles = profiles_in(request.out / f"profile-{slots}")
        figures = figures_of(plan, row, profiles, begun_s)
        self.figures["runs"][name] = figures
        print(f"--- {name}: {workers} workers of {slots} slots", *lines(figures), sep="\n  ")
        sys.stdout.flush()
        return row


def profiles_in(folder: Path) -> list[LoopProfile]:
    """Profiles of the simulators of a run, in the order in which they began."""
    profiles = [
        msgspec.json.decode(path.read_bytes(), type=LoopProfile) for path in folder.glob("*.json")
    ]
    return sorted(profiles, key=lambda profile: profile.begun_s)


def rigs_of(plan: Plan) -> Counter[str]:
    """Rig keys of a plan's cases, with the number of cases of each."""
    return Counter(rig_key(case) for case in plan.cases)


def figures_of(
    plan: Plan, row: SlotsRow, profiles: Sequence[LoopProfile], begun_s: float
) -> dict[str, Any]:
    """What is told of a run; times count from the command on [s]."""
    first_s = min(profile.first_tick_s for profile in profiles)
    last_s = max(profile.last_tick_s for profile in profiles)
    return {
        "cases": row.cases,
        "command_to_page_s": round(row.wall_s, 2),
        "first_simulator_s": round(profiles[0].begun_s - begun_s, 2),
        "first_tick_s": round(first_s - begun_s, 2),
        "last_tick_s": round(last_s - begun_s, 2),
        "page_s": round(row.wall_s - (last_s - begun_s), 2),
        "sim_s": round(row.sim_s, 1),
        "rigs": sorted(rigs_of(plan).values(), reverse=True),
        "roads": len({case.rig.scene for case in plan.cases}),
        "simulators_started": len(profiles),
        "slots": row.slots,
        "slot_use": round(row.slot_use, 3),
        "ticks": row.ticks,
        "frames_per_s": round(row.frames / row.loop_s),
        "shares": {name: round(share, 3) for name, share in row.shares.items()},
        "laps_s": row.laps_s,
        "gpu_percent": row.gpu_percent,
        "gpu_memory_bytes": row.gpu_memory_bytes,
        "transport": row.transport,
        "fingerprint": row.fingerprint,
    }


def lines(figures: dict[str, Any]) -> list[str]:
    """The figures of a run for people."""
    percent, memory = figures["gpu_percent"], figures["gpu_memory_bytes"]
    gpu = "-" if percent is None else f"{percent:.0f} %"
    gpu += "" if memory is None else f", {memory / 1e9:.1f} GB"
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in figures["shares"].items())
    laps = sorted(figures["laps_s"].items(), key=lambda lap: -lap[1])
    return [
        f"{figures['cases']} cases in {figures['command_to_page_s']:.1f} s from command to page: "
        f"simulator at {figures['first_simulator_s']:.1f} s, first tick at "
        f"{figures['first_tick_s']:.1f} s, last at {figures['last_tick_s']:.1f} s, "
        f"{figures['page_s']:.1f} s for the page",
        f"cases per rig: {figures['rigs']} on {figures['roads']} roads; simulators started: "
        f"{figures['simulators_started']}",
        f"{figures['sim_s']:,.0f} simulated s, {figures['ticks']} ticks, "
        f"{100 * figures['slot_use']:.0f} % of the slots in use, {figures['frames_per_s']:,} "
        f"pictures/s, GPU {gpu}, by {figures['transport']}",
        f"loop: {shares}",
        "laps: " + ", ".join(f"{name} {spent_s:.1f} s" for name, spent_s in laps),
        f"fingerprint {figures['fingerprint'][:16]}",
    ]


def check_campaign(check: RulebookCheck, name: str, ways: Sequence[Way]) -> dict[str, float]:
    """All runs of a campaign; times from command to page of those that count, by way [s]."""
    campaign = check.campaign_file(name)
    rigs = rigs_of(load(campaign))
    roads = len({case.rig.scene for case in load(campaign).cases})
    check.expect(f"{name}: {len(rigs)} rigs for {roads} roads", holds=len(rigs) <= roads)
    prints, times_s = {}, {}
    for way in ways:
        row = check.run(campaign, way, check.rows)
        prints[way.name] = row.fingerprint[:16]
        if way.counts:
            times_s[way.name] = row.wall_s
        check.write()
    same = len(set(prints.values())) == 1
    check.expect(f"{name}: fingerprints {prints}", holds=same)
    if same:
        print(f"{name}: {len(prints)} runs, all fingerprints are {next(iter(prints.values()))}")
    return times_s


def main() -> int:
    """Run everything, print what holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--campaigns", default=CAMPAIGNS, help="names or paths, with commas")
    parser.add_argument("--rows", default="", help="as `conductor run --rows`; default: all")
    parser.add_argument("--runs", default=",".join(way.name for way in WAYS), help="with commas")
    parser.add_argument("--quick", action="store_true", help="a rehearsal")
    options = parser.parse_args()
    options.out = options.out.absolute()
    options.out.mkdir(parents=True, exist_ok=True)
    check = RulebookCheck(options)
    ways = [way for way in WAYS if way.name in options.runs.split(",")]
    campaigns = options.campaigns.split(",")
    if not options.quick:
        warm = check.campaign_file(campaigns[0])
        check.run(warm, Way("warm", 1, counts=False), WARM_ROWS, quick=True)
    sums_s: Counter[str] = Counter()
    for name in campaigns:
        sums_s.update(check_campaign(check, name, ways))
    for way, spent_s in sums_s.items():
        within = spent_s <= LIMIT_S or options.quick
        print(f"{way}: {spent_s:.1f} s from command to page; the limit is {LIMIT_S:g} s")
        check.expect(f"{way}: {spent_s:.1f} s of {LIMIT_S:g} s", holds=within)
    check.figures["command_to_page_s"] = dict(sums_s)
    check.write()
    print("all holds" if not check.wrong else f"does not hold: {'; '.join(check.wrong)}")
    return int(bool(check.wrong))


if __name__ == "__main__":
    sys.exit(main())
