"""``twin bench all``: every bench in a process of its own, a figure per target.

A target is one number of one bench: a rate, where more is better, or a time, where less is. The
benches are the commands that people type, asked for JSON; what they print is held to be theirs
only where the keys below are found.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from schemas.escape import escape
from schemas.files.json_text import JsonError, decode_json
from twin.base.progress import steps

Better = Literal["more", "less"]
BENCH_MAX_S = 1800
"""Longest time of one bench [s]."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of a bench."""

    target: str
    """Its name, such as ``camera lambert``."""
    value: float
    unit: str
    better: Better


@dataclass(frozen=True, slots=True)
class Bench:
    """A command, and the figures in what it prints."""

    name: str
    words: Callable[[str], list[str]]
    """Device -> module and arguments, behind ``python -m``."""
    figures: Callable[[Any], list[Figure]]
    """What it printed, decoded -> figures.

    Raises LookupError, TypeError or ValueError where it is something else."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a bench."""

    figures: list[Figure]
    failure: str = ""
    """Why there are no figures, in one line; empty: there are."""


def _rate(bench: str, key: str, unit: str, target: str = "") -> Callable[[Any], list[Figure]]:
    return lambda told: [Figure(target or bench, float(told[key]), unit, "more")]


def _cameras(told: Any) -> list[Figure]:
    return [
        Figure(f"camera {each['picture']}", float(each["frames_per_s"]), "frames/s", "more")
        for each in told["pictures"]
    ]


def _lidars(told: Any) -> list[Figure]:
    return [
        Figure("lidar", float(told["rays_per_s"]), "rays/s", "more"),
        Figure("lidar bare ranges", float(told["bare_rays_per_s"]), "rays/s", "more"),
    ]


def _drives(told: Any) -> list[Figure]:
    ways = {"shared": "shared memory", "loopback": "TCP", "payload": "payload over TCP"}
    return [
        Figure(f"drive plane, {words}", float(told[f"{way}_ticks_per_s"]), "ticks/s", "more")
        for way, words in ways.items()
    ]


def _campaigns(told: Any) -> list[Figure]:
    full = [row for row in told["rows"] if row["everything"]]
    read = [row for row in told["rows"] if not row["everything"]]
    row = full[-1]
    name = f"campaign {told['campaign']}"
    return [
        Figure(name, float(row["ms_per_sim_s"]), "ms/sim s", "less"),
        *(
            Figure(f"{name}, as read", float(row["ms_per_sim_s"]), "ms/sim s", "less")
            for row in read[-1:]
        ),
        Figure(f"{name}, loop", float(row["loop_ms_per_sim_s"]), "ms/sim s", "less"),
        Figure(f"{name}, slot use", 100.0 * float(row["slot_use"]), "%", "more"),
    ]


def _conductors(told: Any) -> list[Figure]:
    return [
        Figure("conductor, 1 per request", float(told["k1_cases_per_s"]), "cases/s", "more"),
        Figure("conductor, 8 per request", float(told["k8_cases_per_s"]), "cases/s", "more"),
    ]


def _twin(name: str, *more: str) -> Callable[[str], list[str]]:
    return lambda device: ["twin", "bench", name, "--device", device, *more, "--output", "json"]


def _campaign_words(device: str) -> list[str]:
    on_gpu = ("aeb-256", "--slots", "64", "--workers", "4xcuda")
    return _twin("campaign", *(on_gpu if device != "cpu" else ("aeb-demo", "--slots", "4")))(device)


def _without_device(*words: str) -> Callable[[str], list[str]]:
    return lambda _device: [*words, "--output", "json"]


def _environments(told: Any) -> list[Figure]:
    return [
        Figure("gym", float(told["frames_per_s"]), "frames/s", "more"),
        Figure("gym, share of a campaign", 100.0 * float(told["share"]), "%", "more"),
    ]


BENCHES = (
    Bench("vehicle", _twin("vehicle"), _rate("vehicle", "substeps_per_s", "substeps/s")),
    Bench("camera", _twin("camera", "--quick"), _cameras),
    Bench("lidar", _twin("lidar"), _lidars),
    Bench("radar", _twin("radar"), _rate("radar", "frames_per_s", "measurements/s")),
    Bench(
        "storyboard",
        _twin("storyboard", "--quick"),
        lambda told: [Figure("storyboard step", float(told["step_ms"]), "ms", "less")],
    ),
    Bench("drive", _without_device("twin", "bench", "drive", "--ticks", "300"), _drives),
    Bench("campaign", _campaign_words, _campaigns),
    Bench("gym", _twin("gym"), _environments),
    Bench(
        "conductor",
        _without_device("conductor", "bench", "--tasks", "2000", "--rounds", "1", "--cases", "0"),
        _conductors,
    ),
)


def measure(
    benches: Collection[Bench], device: str, run: Callable[[Sequence[str]], Outcome | str]
) -> dict[str, Outcome]:
    """What every bench comes to, by its name; one that fails does not keep the others.

    Args:
        benches: in the order in which they run.
        device: where, ``cpu`` or ``cuda:N``.
        run: runs a command; what it printed, or why it failed.
    """
    outcomes = {}
    for bench in steps("benches", benches):
        said = run(bench.words(device))
        outcomes[bench.name] = said if isinstance(said, Outcome) else read_figures(bench, said)
    return outcomes


def read_figures(bench: Bench, printed: str) -> Outcome:
    """The figures in what a bench printed."""
    try:
        figures = bench.figures(decode_json(printed))
    except (JsonError, LookupError, TypeError, ValueError) as error:
        return Outcome([], f"printed something else: {escape(repr(error), 200)}")
    if bad := [each for each in figures if not 0.0 < each.value < float("inf")]:
        return Outcome([], f"{bad[0].target} is {bad[0].value:g} {bad[0].unit}: no measurement")
    return Outcome(figures)


def in_a_process(words: Sequence[str]) -> Outcome | str:
    """Run ``python -m WORDS``; what it printed, or why it failed."""
    command = [sys.executable, "-m", *words]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            timeout=BENCH_MAX_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome([], f"took longer than {BENCH_MAX_S:g} s")
    if done.returncode:
        said = last_line(done.stderr)
        return Outcome([], f"ended with exit code {done.returncode}: {said}")
    return done.stdout.decode(errors="replace")


def last_line(stderr: bytes) -> str:
    """The last line that a process wrote, escaped."""
    lines = stderr.decode(errors="replace").split("\n")
    return escape(next((line for line in reversed(lines) if line.strip()), "nothing said"), 300)
