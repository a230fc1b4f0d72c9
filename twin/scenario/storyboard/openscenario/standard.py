"""Element types of OpenSCENARIO XML 1.0 to 1.3: the one table that drives the reader and the page.

A type stands as ``Name>1: "text" attribute=type? ... / Child Child:Type* A|B|?``. ``>1``: since
version 1.1; ``<2``: until version 1.2; ``?``: optional; ``*``: any number; ``+``: one or more;
``{2}``: two or more; ``A|B``: one of them; ``A|B|?``: one or none. Types of attributes are ``s``
string, ``d`` double, ``i`` integer, ``u`` unsigned integer, ``b`` boolean, ``t`` date and time, or
an enumeration. What was mandatory in one version only is optional here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

from twin.scenario.storyboard.openscenario.enumerations import ENUMS
from twin.scenario.storyboard.openscenario.types_a_to_n import TYPES as FIRST_TYPES
from twin.scenario.storyboard.openscenario.types_o_to_z import TYPES as LAST_TYPES

MINOR_MAX = 3
"""Newest version that is read, 1.3."""

REFUSED = {
    "UserDefinedDistribution": "its meaning is known to its author only; use a set, a range or a "
    "stochastic distribution of the standard",
}
"""Element types that are refused, with the reason."""

IGNORED = {
    "xsi:noNamespaceSchemaLocation": "names a schema file; the reader has its own table",
    "xsi:schemaLocation": "names a schema file; the reader has its own table",
}
"""Attributes of the root that are ignored, with the reason."""

ROOT_TYPES = """
ScenarioFile: / FileHeader ParameterDeclarations? VariableDeclarations?>2 MonitorDeclarations?>3
  CatalogLocations RoadNetwork Entities Storyboard
CatalogFile: / FileHeader Catalog
DistributionFile>1: / FileHeader ParameterValueDistribution
"""


@dataclass(frozen=True, slots=True)
class AttributeRule:
    """One attribute of an element type."""

    name: str
    type_name: str
    """``s d i u b t``, or the name of an enumeration."""
    optional: bool
    since: int
    until: int
    """First and last minor version that has it."""


@dataclass(frozen=True, slots=True)
class ChildRule:
    """One child of an element type."""

    name: str
    type_name: str
    least: int
    many: bool
    since: int
    until: int


@dataclass(frozen=True, slots=True)
class ElementRule:
    """One element type."""

    name: str
    since: int
    until: int
    has_text: bool
    attributes: dict[str, AttributeRule]
    children: dict[str, ChildRule]
    choices: tuple[tuple[bool, tuple[str, ...]], ...]
    """Groups of children of which exactly one kind occurs; True: or none."""


_ITEM = re.compile(r"(\w+)(?::(\w+))?(\?|\*|\+|\{\d\})?(?:>(\d))?(?:<(\d))?$")
_ATTRIBUTE = re.compile(r"(\w+)=(\w+)(\??)(?:>(\d))?(?:<(\d))?$")


@cache
def element_rules() -> dict[str, ElementRule]:
    """Every element type by its name."""
    rules = [_rule(line) for line in _lines(ROOT_TYPES + FIRST_TYPES + LAST_TYPES)]
    return {rule.name: rule for rule in rules}


@cache
def enumerations() -> dict[str, dict[str, int]]:
    """Values of every enumeration, with the first minor version that has each."""
    tables: dict[str, dict[str, int]] = {}
    for line in _lines(ENUMS):
        name, _, rest = line.partition(":")
        values = (value.partition(">") for value in rest.split())
        tables[name] = {value: int(since or 0) for value, _, since in values}
    return tables


Fate = Callable[[str, str], str]
"""What happens with an element type and one of its attributes (empty: with the element)."""


def coverage(fate_of: Fate) -> Iterator[tuple[str, str, str, str]]:
    """Rows of the reference table: element type, attribute (or empty), versions, what happens."""
    for name, rule in sorted(element_rules().items()):
        yield name, "", _versions(rule.since, rule.until), fate_of(name, "")
        for attribute in rule.attributes.values():
            since = max(rule.since, attribute.since)
            versions = _versions(since, min(rule.until, attribute.until))
            yield name, attribute.name, versions, fate_of(name, attribute.name)
    for name, reason in IGNORED.items():
        yield "OpenSCENARIO", name, _versions(0, MINOR_MAX), f"ignored: {reason}"


def coverage_table(fate_of: Fate) -> list[str]:
    """The reference table as Markdown: a row per element type, ignored attributes last."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    key = ("", "", "")
    for name, attribute, versions, fate in coverage(fate_of):
        if not attribute or fate.startswith("ignored"):
            key = name, versions, fate
            rows[key] = [attribute] if attribute else []
        else:
            words = [versions] if versions != key[1] else []
            words += [fate] if fate != key[2] else []
            rows[key].append(f"`{attribute}`" + (f" ({'; '.join(words)})" if words else ""))
    return [
        "| element type | versions | attributes | what happens |",
        "|---|---|---|---|",
        *(
            f"| `{name}` | {versions} | {', '.join(attributes) or 'none'} | {fate} |"
            for (name, versions, fate), attributes in rows.items()
        ),
    ]


def _versions(since: int, until: int) -> str:
    return f"1.{since}" if since == until else f"1.{since} to 1.{until}"


def _lines(text: str) -> list[str]:
    return [
        line
        for line in re.sub(r"\n +", " ", re.sub(r"\|\n +", "|", text)).splitlines()
        if line.strip()
    ]


def _rule(line: str) -> ElementRule:
    head, _, rest = line.partition(":")
    match = _ITEM.match(head)
    assert match, line
    attributes_text, _, children_text = rest.partition("/")
    words = attributes_text.split()
    attributes = [_attribute(word) for word in words if word != '"text"']
    children: dict[str, ChildRule] = {}
    choices: list[tuple[bool, tuple[str, ...]]] = []
    for group in children_text.split():
        alternatives = [_child(word) for word in group.split("|") if word != "?"]
        children |= {child.name: child for child in alternatives}
        if len(alternatives) > 1:
            optional = group.endswith("|?") or all(a.least == 0 for a in alternatives)
            choices.append((optional, tuple(child.name for child in alternatives)))
    return ElementRule(
        name=match[1],
        since=int(match[4] or 0),
        until=int(match[5] or MINOR_MAX),
        has_text='"text"' in words,
        attributes={attribute.name: attribute for attribute in attributes},
        children=children,
        choices=tuple(choices),
    )


def _attribute(word: str) -> AttributeRule:
    match = _ATTRIBUTE.match(word)
    assert match, word
    since, until = int(match[4] or 0), int(match[5] or MINOR_MAX)
    return AttributeRule(match[1], match[2], bool(match[3]), since, until)


def _child(word: str) -> ChildRule:
    match = _ITEM.match(word)
    assert match, word
    count = match[3] or ""
    least = int(count[1]) if count.startswith("{") else 0 if count in ("?", "*") and count else 1
    since, until = int(match[4] or 0), int(match[5] or MINOR_MAX)
    return ChildRule(
        match[1], match[2] or match[1], least, count[:1] in ("*", "+", "{"), since, until
    )
