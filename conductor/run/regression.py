"""Failures of a run as cases of a campaign file: the same values, the same random numbers.

``conductor regress`` writes the file or adds to it; its own lines and comments stay as they are.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import yaml
from msgspec import UNSET, Struct

from conductor.records.outcomes import Outcomes, read_outcomes
from conductor.records.search import read_search
from conductor.run.source import load
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.escape import escape
from schemas.files.search_result import SearchFile
from schemas.files.yaml_file import YamlError, parse_yaml, read_yaml_text
from schemas.identity import case_digest
from schemas.names import Name
from schemas.plan import Plan
from schemas.repeated import DRAWN_AS, Repeated, repeated_of
from schemas.sections.stack_identity import StackIdentity, StackSource
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.records.campaign_file import read_plan

CAMPAIGN_FILE = "campaign.yaml"
_OF_THE_RUN = {
    *("campaign", "description", "seed", "matrix", "cases", "exclude", "search", "batch"),
    *("view", "recording", "attempts_max", "files", "plugins", "stack_identity"),
}
"""Keys of a campaign that are left behind."""
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
    search = None if plan.campaign.search is UNSET else read_search(run)
    names = list(dict.fromkeys(names)) or _mildest(search, run)
    _check_run(plan, names, run)
    repeated = {name: _repeated(plan, name) for name in names}
    lines = []
    for name in names:
        lines.append(f"# {escape(_finding(run, name, outcomes, search))}")
        lines += _dumped([_entry(plan, name, repeated[name])])
    before = _text_of(into)
    text = _begun(plan.campaign, into) if before is None else before
    known = set() if before is None else _known(text, into)
    for each in repeated.values():
        if each.words in known:
            raise UsageError(f"{into}: has {each.words} already; nothing was added")
    text = _added(text, lines, into)
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


def _entry(plan: Plan, name: str, repeated: Repeated) -> dict[str, Any]:
    point = next(point for point in plan.points if point.id == name)
    return {DRAWN_AS: repeated.words, **{k: v for k, v in point.values.items() if k != DRAWN_AS}}


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
    return f"{run}, {name}: {'; '.join(parts)}"


def _text_of(into: Path) -> str | None:
    if not into.exists():
        return None
    try:
        return read_yaml_text(into)
    except YamlError as error:
        raise UsageError(str(error)) from None


def _begun(campaign: Campaign, into: Path) -> str:
    """A new file without cases yet: what all cases of the run share."""
    try:
        msgspec.convert(into.stem, Name)
    except msgspec.ValidationError:
        raise UsageError(
            f"--into {into}: a campaign is named as its file; take small letters, digits and ._-"
        ) from None
    default = Campaign(campaign=into.stem)
    kept = {
        key: said
        for key, said in _said(campaign, default).items()
        if key not in _OF_THE_RUN and said != {}
    }
    head = "# Failures that were found once, and are run again: see `conductor regress`.\n"
    return head + "".join(f"{line}\n" for line in _dumped({"campaign": into.stem, **kept}))


def _said(section: Struct, default: Struct) -> dict[str, Any]:
    """The fields in which a section differs from its defaults, as plain data."""
    said: dict[str, Any] = {}
    for name in section.__struct_fields__:
        value, usual = getattr(section, name), getattr(default, name)
        if value == usual:
            continue
        if isinstance(value, Struct) and type(value) is type(usual):
            said[name] = _said(value, usual)
        else:
            said[name] = msgspec.to_builtins(value)
    return said


def _dumped(data: Any) -> list[str]:
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=1000)
    return text.splitlines()


def _known(text: str, into: Path) -> set[str]:
    """The cases that a file repeats already."""
    try:
        data = parse_yaml(text, str(into))
    except YamlError as error:
        raise UsageError(str(error)) from None
    cases = data.get("cases") if isinstance(data, dict) else None
    points = cases if isinstance(cases, list) else []
    return {str(point.get(DRAWN_AS)) for point in points if isinstance(point, dict)}


def _added(text: str, lines: Sequence[str], into: Path) -> str:
    """The text with further entries at the end of its list ``cases``.

    Raises:
        UsageError: that list is not written line by line.
    """
    text = text if text.endswith("\n") else f"{text}\n"
    if re.search(r"^(\.\.\.|---)", text, re.MULTILINE):
        raise UsageError(f"{into}: a line of it begins with --- or ...; remove that line")
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    keys = root.value if isinstance(root, yaml.MappingNode) else []
    node = next((value for key, value in keys if key.value == "cases"), None)
    if node is None:
        flow = isinstance(root, yaml.MappingNode) and root.flow_style
        if not isinstance(root, yaml.MappingNode) or flow:
            raise UsageError(f"{into}: no campaign, with a key on each line")
        return text + "\n".join(["cases:", *lines]) + "\n"
    if not isinstance(node, yaml.SequenceNode) or node.flow_style or not node.value:
        raise UsageError(f"{into}: write cases as a list with a line for each, or remove the key")
    end = _last(node).end_mark
    place = end.line + (1 if end.column else 0)
    pad = " " * node.start_mark.column
    kept = text.splitlines()
    return "\n".join([*kept[:place], *(pad + line for line in lines), *kept[place:]]) + "\n"


def _last(node: yaml.Node) -> yaml.Node:
    """The last scalar of a node, or an empty or bracketed part."""
    nested = isinstance(node, yaml.CollectionNode) and node.value and not node.flow_style
    if not nested:
        return node
    last = node.value[-1]
    return _last(last[1] if isinstance(last, tuple) else last)


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
    return Case(rig=rig, variation=replace(variation, drive="none"))
