"""Which case an environment runs in which episode, and with which seed."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from schemas.case import Case, RigSpec
from schemas.identity import stream_key
from schemas.kinds.scenario import ScenarioKind, kind_of
from schemas.plan import Plan, parse_plan
from schemas.sections.stack_identity import StackSource
from schemas.validation import suggest
from twin.base.errors import UsageError
from twin.base.software import package_folder
from twin.records.extended_file import read_extended

PASSES_MAX = 16
"""Passes over the cases of a rulebook that are kept; others are drawn again."""


class EpisodeCases:
    """The cases of a campaign in the order in which environments run them.

    An environment of seed ``s`` runs in episode ``k`` the case number ``s - c + k`` of the
    campaign, counted round, where ``c`` is the seed in the campaign file. In its first pass over
    the cases it runs them as ``conductor run --seed s`` does, in each later pass with a seed that
    is drawn from ``s`` and the number of the pass. Nothing depends on the number of environments.
    """

    def __init__(self, plan: Plan) -> None:
        """Take the cases of a plan.

        Raises:
            UsageError: the cases cannot run on one engine, or not in lockstep; one line.
        """
        self._plan = plan
        self.cases = plan.cases
        self._drawn = functools.lru_cache(maxsize=PASSES_MAX)(self._draw)
        self.seed = plan.campaign.seed
        """Seed of the campaign file."""
        self._check(plan.campaign.campaign)

    @property
    def kind(self) -> ScenarioKind:
        """Declaration of the scenario's family."""
        return kind_of(self.cases[0].variation.scenario)

    def of(self, seed: int, episode: int, first: int | None = None) -> Case:
        """The case of an episode.

        Args:
            seed: of the environment, 0 to :data:`schemas.sections.repeated.SEED_MAX`.
            episode: from 0 on.
            first: number of the case of episode 0; None: as the seed says.
        """
        count = len(self.cases)
        start = (seed - self.seed) % count if first is None else first
        turn = episode // count
        if turn:
            seed = stream_key(seed, self._plan.campaign.campaign, f"gym pass {turn}") >> 1
        return self._seeded((start + episode) % count, seed)

    def number(self, name: str) -> int:
        """Number of the case of a name.

        Raises:
            UsageError: there is none; one line.
        """
        names = [case.id for case in self.cases]
        if name not in names:
            raise UsageError(
                f"case {name!r}: the environment has none of that name; {suggest(name, names)}"
            )
        return names.index(name)

    def _seeded(self, number: int, seed: int) -> Case:
        case = self.cases[number]
        if seed == self.seed:
            return case
        if self._plan.campaign.rulebook is UNSET and case.variation.origin is UNSET:
            variation = msgspec.structs.replace(case.variation, seed=seed)
            return msgspec.structs.replace(case, variation=variation)
        return self._drawn(seed)[number]

    def _draw(self, seed: int) -> list[Case]:
        """All cases with another seed, which rows of a rulebook draw by."""
        campaign = msgspec.structs.replace(self._plan.campaign, seed=seed)
        return self._plan.amended(campaign).cases

    def _check(self, name: str) -> None:
        if not self.cases:
            raise UsageError(f"{name}: no case to run; choose others with cases")
        first = self.cases[0].rig
        if first.simulator != "warp":
            raise UsageError(f"{name}: simulator '{first.simulator}' given, allowed: warp")
        if first.clock != "lockstep":
            raise UsageError(f"{name}: clock '{first.clock}' given, allowed: lockstep")
        rigs = [_simulated(case.rig) for case in self.cases]
        if others := [c.id for c, rig in zip(self.cases, rigs, strict=True) if rig != rigs[0]]:
            raise UsageError(
                f"{name}: its cases need several worlds, vehicles or sets of sensors, and an "
                f"environment has one; {self.cases[0].id} and {others[0]} differ; choose with cases"
            )


def _simulated(rig: RigSpec) -> RigSpec:
    """The rig as far as an engine is built for it: without the stack."""
    nothing: dict[str, Any] = {"stack": "", "foreign": None, "source": StackSource(), "models": []}
    nothing |= {"parameters": {}, "slots": 0, "placement": "inline", "files": {}}
    return msgspec.structs.replace(rig, **nothing)


def read_cases(
    campaign: str | Path,
    settings: Mapping[str, Any] | None = None,
    cases: Sequence[str] | None = None,
) -> EpisodeCases:
    """Read a campaign; its stack is not looked for.

    Args:
        campaign: shipped name, or path of a file.
        settings: keys at the top of the file that are replaced, each whole.
        cases: names of the cases to run, in the campaign's order; None: all.

    Raises:
        UsageError: no such campaign, or it has mistakes; one line each.
    """
    shown = str(campaign)
    path = _find(shown)
    data = read_extended(path, shown, _find)
    if isinstance(data, dict):
        data = {**data, **(settings or {})}
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise UsageError("\n".join(mistake.line(shown) for mistake in mistakes))
    if plan.campaign.search is not UNSET:
        raise UsageError(
            f"{shown}: a search proposes its cases from results; give a campaign that lists them"
        )
    if cases is not None:
        names = [point.id for point in plan.points]
        for name in cases:
            if name not in names:
                raise UsageError(f"{shown}: no case {name!r}; {suggest(name, names)}")
        plan = plan.among(cases)
    return EpisodeCases(plan)


def _find(name: str) -> Path:
    """The file of a shipped campaign's name, or of a path."""
    folder = package_folder("conductor") / "campaigns"
    shipped = sorted(path.stem for path in folder.glob("*.yaml"))
    if name in shipped:
        return folder / f"{name}.yaml"
    if Path(name).is_file():
        return Path(name)
    hint = suggest(name, shipped)
    raise UsageError(f"{name}: neither a shipped campaign nor a file; {hint}, or a file's path")
