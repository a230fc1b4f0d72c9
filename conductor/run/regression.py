"""Failures of a run as cases of a campaign file: the same values, the same random numbers.

``conductor regress`` writes the file or adds to it; its own lines and comments stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec import UNSET

from conductor.records.kept_cases import begun_text, dumped, entry_of, repeated_in, with_cases
from conductor.records.outcomes import Outcomes, read_outcomes
from conductor.records.search import read_search
from conductor.run.source import load
from conductor.serve.folders import CAMPAIGN_FILE
from schemas.case import Case
from schemas.escape import escape
from schemas.files.search_result import SearchFile
from schemas.files.yaml_file import YamlError, read_yaml_text
from schemas.identity import case_digest
from schemas.plan import Plan
from schemas.sections.repeated import DRAWN_AS, Repeated, repeated_of
from schemas.sections.stack_identity import StackIdentity, StackSource
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.records.campaign_file import read_plan

_STACK = ("stack", "foreign", "parameters", "source", "perception", "model")
"""Parts of a case that say what is under test."""


def regress(run: Path, names: Sequence[str], into: Path) -> list[str]:
    """Add cases of a run to a campaign file, which is made if there is none.

    Args:
        run: the run's folder.
        names: its cases; none: the mildest case of each cluster of failures that its search found.
        into: the campaign file.

    Returns:
        The names of the new cases there.

    Raises:
        UsageError: there is no run, case or failure; a case is in the file already, does not
            repeat, or does not fit the file; nothing is written then.
        InfrastructureError: the run is damaged, or the disk lets us down.
    """
    outcomes = read_outcomes(run)
    plan = read_plan(run / CAMPAIGN_FILE)
    section = plan.campaign.search
    search = None if section is UNSET or section.chosen else read_search(run)
    names = list(dict.fromkeys(names)) or _mildest(search, run)
    _check_run(plan, names, run)
    repeated = {name: _repeated(plan, name) for name in names}
    lines = []
    for name in names:
        lines.append(f"# {escape(_finding(run, name, outcomes, search))}")
        lines += dumped([entry_of(plan, name, repeated[name])])
    before = _text_of(into)
    text = begun_text(plan.campaign, into) if before is None else before
    known = set() if before is None else repeated_in(text, into)
    for each in repeated.values():
        if each.words in known:
            raise UsageError(f"{into}: has {each.words} already; nothing was added")
    text = with_cases(text, lines, into)
    _write_if_same(plan, repeated, text, into, run)
    return [each.name for each in repeated.values()]


def _mildest(search: SearchFile | None, run: Path) -> list[str]:
    if search is None:
        raise UsageError(f"{run}: no search was run there; name its cases with --case")
    if not search.clusters:
        state = "found no failure" if search.ended else "has not ended"
        raise UsageError(f"{run}: its search {state}; name cases with --case")
    return [cluster.mildest for cluster in search.clusters]


def _check_run(plan: Plan, names: Sequence[str], run: Path) -> None:
    """Whether cases of a run repeat elsewhere."""
    campaign = plan.campaign
    if campaign.rulebook is not UNSET:
        raise UsageError(f"{run}: cases of a rulebook stay in it; run its rows with --rows")
    if campaign.clock == "realtime":
        raise UsageError(f"{run}: went by the wall clock, so its cases do not repeat")
    cases = {case.id: case for case in plan.cases}
    for name in names:
        if name not in cases:
            raise UsageError(f"--case {name}: no case of {run}")
        if cases[name].variation.forks is not UNSET:
            raise UsageError(
                f"{name} is a fork of another case; `conductor run {run}/{CAMPAIGN_FILE} "
                f"--case {name}` repeats it"
            )


def _repeated(plan: Plan, name: str) -> Repeated:
    """What a case is called elsewhere; one that repeats another is that other."""
    case = next(case for case in plan.cases if case.id == name)
    point = {DRAWN_AS: f"{plan.campaign.campaign}/{case.variation.seed}/{name}"}
    if case.variation.origin is not UNSET:
        return Repeated(case.variation.seed, case.variation.origin)
    repeated = repeated_of(point)
    assert repeated is not UNSET, point
    return repeated


def _finding(run: Path, name: str, outcomes: Outcomes, search: SearchFile | None) -> str:
    """What was found of a case, in a line."""
    end = outcomes.cases[name]
    parts = [end.verdict or end.outcome or "not ended"]
    if search is not None:
        value = end.scalars.get(search.kpi)
        low, high = search.fails_below, search.fails_above
        limit = f", fails below {low:g}" if low is not None else ""
        limit = f", fails above {high:g}" if high is not None else limit
        parts.append(f"{search.kpi} {'missing' if value is None else f'{value:.6g}'}{limit}")
        like = [c for c in search.clusters if c.mildest == name and len(c.cases) > 1]
        parts += [f"{len(c.cases) - 1} further failures beside it" for c in like]
    shown = run if run.name else run.absolute().name
    return f"{shown}, {name}: {'; '.join(parts)}"


def _text_of(into: Path) -> str | None:
    if not into.exists():
        return None
    try:
        return read_yaml_text(into)
    except YamlError as error:
        raise UsageError(str(error)) from None


def _write_if_same(
    plan: Plan, repeated: dict[str, Repeated], text: str, into: Path, run: Path
) -> None:
    """Write the file if its new cases are those of the run.

    It is read as any campaign is, from a file beside it: its paths are relative to its folder.
    """
    draft = into.with_name(f".{into.name}.draft.yaml")
    try:
        write_atomic(draft, text.encode())
        try:
            changed = load(str(draft), fetch=False)
        except UsageError as error:
            raise UsageError(str(error).replace(str(draft), str(into))) from None
        there = {case.id: case for case in changed.cases}
        cases = {case.id: case for case in plan.cases}
        for name, each in repeated.items():
            if problem := _difference(cases[name], there[each.name]):
                raise UsageError(f"{into}: {problem} than {run}; give a file of its own")
        write_atomic(into, text.encode())
    except OSError as error:
        raise storage_error(error, str(into)) from None
    finally:
        draft.unlink(missing_ok=True)


def _difference(one: Case, two: Case) -> str:
    """What differs between a case and the one that is to repeat it, in words; or nothing."""
    first, second = _bare(one), _bare(two)
    if case_digest(first) == case_digest(second):
        return ""
    for part, other in ((first.rig, second.rig), (first.variation, second.variation)):
        for name in part.__struct_fields__:
            if msgspec.to_builtins(getattr(part, name)) != msgspec.to_builtins(
                getattr(other, name)
            ):
                return "has another stack" if name in _STACK else f"has another '{name}'"
    return "has other cases"


def _bare(case: Case) -> Case:
    """A case without its name, and without what may change from run to run: contents of files and
    of the stack."""
    replace = msgspec.structs.replace
    source = StackSource(identity=StackIdentity(), parameters=case.rig.source.parameters)
    rig = replace(case.rig, files={}, source=source, view="live", keep="all", models=[])
    variation = replace(
        case.variation, id="", campaign="", deadline_s=1.0, files={}, origin=UNSET, batch=0
    )
    variation = replace(variation, formula="")  # of a search alone: it only reads the rows
    return Case(rig=rig, variation=replace(variation, drive="none"))
