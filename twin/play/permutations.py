"""One or all permutations of a scenario file, compiled and played."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twin.base.progress import progress
from twin.play.playing import PlayedScenario, play_programs
from twin.play.report import NamedPlay
from twin.road.opendrive.apart import notes_of_reading
from twin.road.tables.road_tables import RoadTables, road_tables
from twin.scenario.storyboard.apart import permutations_apart, programs_apart
from twin.scenario.storyboard.compile.compiler import CompiledScenario
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import is_native, load_native
from twin.world.kernel_cache import prepare_kernels

PLAYED_MAX = 10_000
"""Permutations that are played by one command."""


def play_file(
    file: Path,
    distribution: Path | None,
    permutation: int | None,
    *,
    step_s: float,
    every: int,
    until_s: float,
    device: str = "cpu",
) -> list[NamedPlay]:
    """Play a file or a shipped scenario, or all or one of a file's permutations.

    Raises:
        ValueError: a line per mistake.
        UsageError: a program is larger than a limit.
    """
    if is_native(str(file)):
        if distribution is not None or permutation is not None:
            raise ValueError(f"{file}: a campaign varies scenario files, no distribution does")
        return [_play_native(file, step_s=step_s, every=every, until_s=until_s, device=device)]
    assignments = permutations_apart(file, distribution)
    numbers = _chosen(len(assignments), file, distribution, permutation)
    compiled = list(programs_apart(file, [assignments[number] for number in numbers]))
    prepare_kernels()
    tables: dict[str, RoadTables] = {}
    played: list[PlayedScenario | None] = [None] * len(compiled)
    ended = 0
    with progress("twin play", "playing", "permutations") as report:

        def done(count: int) -> None:
            if len(compiled) > 1:
                report(ended + count, len(compiled))

        for group in _by_roads(compiled):
            network = compiled[group[0]].program.network
            if network is not None and network.file not in tables:
                tables[network.file] = road_tables(network)
            roads = None if network is None else tables[network.file]
            records = play_programs(
                [compiled[number].program for number in group],
                roads,
                step_s=step_s,
                every=every,
                until_s=until_s,
                device=device,
                done=done,
            )
            ended += len(records)
            for number, played_one in zip(group, records, strict=True):
                played[number] = played_one
    stem = (distribution or file).stem
    plays = []
    for number, scenario, record in zip(numbers, compiled, played, strict=True):
        assert record is not None
        name = f"{stem}-{number:03d}" if distribution else stem
        notes = (*notes_of_reading(), *scenario.notes)
        plays.append(NamedPlay(name, number, assignments[number], notes, record))
    return plays


def _play_native(
    file: Path, *, step_s: float, every: int, until_s: float, device: str
) -> NamedPlay:
    program = compile_native(load_native(file))
    roads = None if program.network is None else road_tables(program.network)
    (record,) = play_programs(
        [program], roads, step_s=step_s, every=every, until_s=until_s, device=device
    )
    return NamedPlay(file.stem, 0, {}, (), record)


def _chosen(count: int, file: Path, distribution: Path | None, number: int | None) -> Sequence[int]:
    """Numbers of the permutations to play."""
    if number is not None:
        if distribution is None:
            raise ValueError(f"{file}: --permutation needs --distribution")
        if number >= count:
            raise ValueError(
                f"{distribution}: permutation {number} of {count}; they are counted from 0"
            )
        return [number]
    if not count:
        raise ValueError(f"{distribution}: it makes no permutation")
    if count > PLAYED_MAX:
        raise ValueError(
            f"{distribution}: {count} permutations, at most {PLAYED_MAX} are played at once; give "
            "--permutation"
        )
    return range(count)


def _by_roads(compiled: list[CompiledScenario]) -> list[list[int]]:
    """Numbers of the scenarios that share a road file."""
    groups: dict[str, list[int]] = {}
    for number, scenario in enumerate(compiled):
        network = scenario.program.network
        groups.setdefault("" if network is None else network.file, []).append(number)
    return list(groups.values())
