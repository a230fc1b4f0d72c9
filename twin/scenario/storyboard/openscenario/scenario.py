"""Scenario files and what their parameter distributions make of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.scenario.storyboard.openscenario.catalogs import load_catalogs
from twin.scenario.storyboard.openscenario.distribution import permutations
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.openscenario.reader import ScenarioReader, load_document
from twin.scenario.storyboard.openscenario.references import check_references, named_path


@dataclass(frozen=True, slots=True)
class EffectiveScenario:
    """A file with all its parameters resolved and its catalog entries in place."""

    kind: str
    """``ScenarioFile``, ``CatalogFile`` or ``DistributionFile``."""
    root: ScenarioElement
    parameters: Mapping[str, Value]
    """Global parameters in the order of their declarations."""
    catalogs_used: tuple[str, ...]
    """``catalog/entry`` in the order in which they are met."""


@dataclass(frozen=True, slots=True)
class Permutation:
    """One assignment of a distribution file."""

    number: int
    """From 0, the last distribution of the file varies fastest."""
    values: Mapping[str, Value]
    path: Path

    def scenario(self) -> EffectiveScenario:
        """The effective scenario; raises ValueError as :func:`read_scenario`."""
        return read_scenario(self.path, self.values)


def read_scenario(path: Path, values: Mapping[str, Value] | None = None) -> EffectiveScenario:
    """Read an OpenSCENARIO XML file, with values for some of its global parameters.

    Raises:
        ValueError: a line with file and line number per mistake, at most 100.
    """
    document = load_document(path)
    reader = ScenarioReader()
    if document.kind == "ScenarioFile":
        load_catalogs(document, reader)
    root = reader.read(document, values or {})
    if document.kind == "ScenarioFile":
        check_references(root, reader.parameters, reader.mistakes)
    reader.mistakes.check()
    return EffectiveScenario(document.kind, root, reader.parameters, tuple(reader.catalogs_used))


def expand(path: Path, distribution: Path | None = None) -> list[Permutation]:
    """The permutations of a distribution file for a scenario, one without a distribution.

    Args:
        path: the scenario.
        distribution: its distribution file; the ``ScenarioFile`` that it names must be ``path``.

    Raises:
        ValueError: as :func:`read_scenario`.
    """
    if distribution is None:
        return [Permutation(0, {}, path)]
    file = read_scenario(distribution)
    element = file.root.first("ParameterValueDistribution")
    if element is None:
        raise ValueError(f"{distribution}:1: it has no ParameterValueDistribution")
    named = element.first("ScenarioFile")
    assert named is not None
    target = named_path(distribution, str(named.values["filepath"]))
    if target.resolve() != path.resolve():
        raise ValueError(f"{distribution}:{named.line}: it varies {target}, not {path}")
    return [Permutation(i, values, path) for i, values in enumerate(permutations(element))]
