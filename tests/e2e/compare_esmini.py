"""Table of differences from esmini: ``python tests/e2e/compare_esmini.py [NAME ...] [--standard]``.

Without names all scenario files are compared; with ``--standard`` all given permutations of the
standard variations, too.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from esmini import (
    FILES,
    Difference,
    EsminiRun,
    Pose,
    difference,
    given_trace,
    own_of,
    run_esmini,
)

from twin.play.playing import PlayedScenario, play_programs
from twin.road.tables.road_tables import RoadTables, road_tables
from twin.scenario.storyboard.compile.compiler import RoadCache, compile_scenario
from twin.scenario.storyboard.openscenario.scenario import expand, read_scenario
from twin.scenario.storyboard.program.program import Program
from twin.world.kernel_cache import prepare_kernels

NCAP = FILES / "ncap/OpenSCENARIO/NCAP"
ALKS = FILES / "alks/logical_scenarios/concrete_scenarios"
STANDARD = NCAP / "CA-FC_2026/Variations/StandardRange"
EVERY = 5
"""Steps between poses that are compared."""
CONTROLLED_S = 3.0
"""From then on esmini's own controller drives the ego of the ALKS files."""


def scenario_files() -> list[Path]:
    """The files with a given trace."""
    names = {p.name.removesuffix(".csv.gz") for p in (FILES / "reference").glob("*/*.csv.gz")}
    files = [*NCAP.glob("*/*.xosc"), *ALKS.glob("*.xosc")]
    return sorted(file for file in files if file.stem in names)


class Comparisons:
    """Comparisons that share road networks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._cache: RoadCache = {}
        self._tables: dict[str, RoadTables] = {}

    def compare(
        self, file: Path, change: Callable[[Program], Program] = lambda program: program
    ) -> Difference:
        """One scenario file; ``change`` plants an error."""
        alks = file.parent == ALKS
        program = change(compile_scenario(read_scenario(file), self._cache))
        run = run_esmini(file, self._folder)
        played = self._play([program], [run] if alks else None)[0]
        trace = given_trace(f"{'alks' if alks else 'ncap'}/{file.stem}")
        return difference(file.stem, played, trace, run.changes, own_of(file.stem))

    def compare_variations(self, variations: Path) -> Iterator[Difference]:
        """The given permutations of a distribution file."""
        element = read_scenario(variations).root.first("ParameterValueDistribution")
        assert element is not None
        named = element.first("ScenarioFile")
        assert named is not None
        file = variations.parent / str(named.values["filepath"])
        folder = FILES / "reference/ncap-2026-standard"
        permutations = [
            permutation
            for permutation in expand(file, variations)
            if (folder / f"{variations.stem}-{permutation.number:03d}.csv.gz").exists()
        ]
        programs = [compile_scenario(p.scenario(), self._cache) for p in permutations]
        for permutation, played in zip(permutations, self._play(programs), strict=True):
            name = f"{variations.stem}-{permutation.number:03d}"
            extra = ["--param_dist", str(variations)]
            extra += ["--param_permutation", str(permutation.number)]
            run = run_esmini(file, self._folder, extra)
            yield difference(
                name, played, given_trace(f"ncap-2026-standard/{name}"), run.changes, own_of(name)
            )

    def compare_texts(
        self, scenarios: Mapping[str, str], others: Mapping[str, str] | None = None
    ) -> list[Difference]:
        """Scenarios on the same roads that are no files of others; ``others`` lie beside them."""
        for name, text in (others or {}).items():
            (self._folder / name).write_text(text)
        files = []
        for number, text in enumerate(scenarios.values()):
            files.append(self._folder / f"scenario-{number}.xosc")
            files[-1].write_text(text)
        programs = [compile_scenario(read_scenario(file), self._cache) for file in files]
        results = []
        for name, file, played in zip(scenarios, files, self._play(programs), strict=True):
            run = run_esmini(file, self._folder)
            trace = {
                entity: {step: pose for step, pose in rows.items() if step % EVERY == 0}
                for entity, rows in run.trace.items()
            }
            results.append(difference(name, played, trace, run.changes))
        return results

    def _play(
        self, programs: Sequence[Program], runs: Sequence[EsminiRun] | None = None
    ) -> list[PlayedScenario]:
        network = programs[0].network
        if network is not None and network.file not in self._tables:
            self._tables[network.file] = road_tables(network)
        roads = None if network is None else self._tables[network.file]

        def imposed(number: int, step: int) -> list[tuple[int, tuple[float, ...]]]:
            assert runs is not None
            if step * 0.01 < CONTROLLED_S:
                return []
            pose: Pose | None = runs[number].trace["Ego"].get(step)
            if pose is None:
                return []
            ego = next(i for i, e in enumerate(programs[number].entities) if e.ego)
            x, y, heading, speed = pose
            return [(ego, (x, y, 0.0, heading, 0.0, 0.0, speed))]

        return play_programs(
            programs,
            roads,
            step_s=0.01,
            every=EVERY,
            until_s=310.0,
            imposed=imposed if runs else None,
        )


def main() -> None:
    """Print the table; exit code 1 if something disagrees."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--standard", action="store_true")
    options = parser.parse_args()
    prepare_kernels()
    bad, total = 0, 0
    print("scenario | entities | distance m | heading deg | chords m, deg | event steps | worst")
    with tempfile.TemporaryDirectory() as folder:
        comparisons = Comparisons(Path(folder))
        for result in _results(comparisons, options.names, options.standard):
            total += 1
            bad += not result.agrees
            mark = "" if result.agrees else " <---"
            print(
                f"{result.name} | {result.entities} | {result.distance_m:.4f} | "
                f"{result.heading_deg:.4f} | {result.chord_m:.4f}, {result.chord_deg:.4f} | "
                f"{max(result.event_steps, result.end_steps)} | {result.where} "
                f"{result.event}{mark}"
            )
    print(f"{total - bad} of {total} agree")
    raise SystemExit(1 if bad else 0)


def _results(
    comparisons: Comparisons, names: Sequence[str], standard: bool
) -> Iterator[Difference]:
    for file in scenario_files():
        if not names or any(name in file.stem for name in names):
            yield comparisons.compare(file)
    if standard:
        for file in sorted(STANDARD.glob("*.xosc")):
            if not names or any(name in file.stem for name in names):
                yield from comparisons.compare_variations(file)


if __name__ == "__main__":
    main()
