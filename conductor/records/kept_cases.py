"""The text of a campaign file that keeps cases of other runs: begun, read, and added to."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import yaml
from msgspec import Struct

from schemas.campaign import Campaign
from schemas.files.yaml_file import YamlError, dump_yaml, parse_yaml
from schemas.names import Name
from schemas.plan import Plan
from schemas.sections.repeated import DRAWN_AS, Repeated
from twin.base.errors import UsageError

_OF_THE_RUN = {
    *("campaign", "description", "seed", "matrix", "cases", "exclude", "search", "batch"),
    *("view", "recording", "attempts_max", "files", "plugins", "stack_identity"),
}
"""Keys of a campaign that are left behind."""


def entry_of(plan: Plan, name: str, repeated: Repeated) -> dict[str, Any]:
    """The entry of a case: what it repeats, and its values."""
    point = next(point for point in plan.points if point.id == name)
    return {DRAWN_AS: repeated.words, **{k: v for k, v in point.values.items() if k != DRAWN_AS}}


def begun_text(campaign: Campaign, into: Path) -> str:
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
    return head + "".join(f"{line}\n" for line in dumped({"campaign": into.stem, **kept}))


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


def dumped(data: Any) -> list[str]:
    """Lines of YAML."""
    return dump_yaml(data, width=1000).splitlines()


def repeated_in(text: str, into: Path) -> set[str]:
    """The cases that a file repeats already."""
    try:
        data = parse_yaml(text, str(into))
    except YamlError as error:
        raise UsageError(str(error)) from None
    cases = data.get("cases") if isinstance(data, dict) else None
    points = cases if isinstance(cases, list) else []
    return {str(point.get(DRAWN_AS)) for point in points if isinstance(point, dict)}


def with_cases(text: str, lines: Sequence[str], into: Path) -> str:
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
