"""The reader: XML against the table of the standard, with parameters, into elements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from schemas.validation import suggest
from twin.base.xml_file import read_xml
from twin.scenario.storyboard.openscenario.element import ScenarioElement, ScenarioMistakes
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.openscenario.standard import (
    IGNORED,
    MINOR_MAX,
    REFUSED,
    ChildRule,
    ElementRule,
    element_rules,
)
from twin.scenario.storyboard.openscenario.values import PARAMETER_TYPES, convert, value_of

FILE_BYTES_MAX = 16 << 20
"""Largest file [bytes]."""
DEPTH_MAX = 64
"""How deep elements may nest in a file."""
ELEMENTS_MAX = 200_000
"""Elements of one file."""
PLACED_ELEMENTS_MAX = 400_000
"""Elements of a scenario, with entries of catalogs in place of their references."""
CATALOG_DEPTH_MAX = 16
"""How deep catalog entries may refer to others."""
_XSI = "{http://www.w3.org/2001/XMLSchema-instance}"

Scope = dict[str, Value]


@dataclass(frozen=True, slots=True)
class ScenarioDocument:
    """One file of OpenSCENARIO XML, before its parameters have values."""

    path: Path
    minor: int
    kind: str
    """``ScenarioFile``, ``CatalogFile`` or ``DistributionFile``."""
    root: Any


def load_document(path: Path) -> ScenarioDocument:
    """Parse a file and look at its header; raises ValueError with one line."""
    root = read_xml(
        path,
        root="OpenSCENARIO",
        bytes_max=FILE_BYTES_MAX,
        depth_max=DEPTH_MAX,
        elements_max=ELEMENTS_MAX,
    )
    header = root.find("FileHeader")
    if header is None:
        raise ValueError(f"{path}:{root.sourceline}: OpenSCENARIO has no FileHeader")
    major, minor = header.get("revMajor", ""), header.get("revMinor", "")
    if major != "1" or minor not in [str(known) for known in range(MINOR_MAX + 1)]:
        raise ValueError(
            f"{path}:{header.sourceline}: version {major}.{minor}, read are 1.0 to 1.{MINOR_MAX}"
        )
    kind = "ScenarioFile"
    for name, other in (("Catalog", "Catalog"), ("ParameterValueDistribution", "Distribution")):
        if root.find(name) is not None:
            kind = f"{other}File"
    return ScenarioDocument(path, int(minor), kind, root)


@dataclass(slots=True)
class ScenarioReader:
    """Reads one scenario with the catalogs that it uses."""

    mistakes: ScenarioMistakes = field(default_factory=ScenarioMistakes)
    catalogs: dict[str, tuple[ScenarioDocument, Any]] = field(default_factory=dict)
    """Document and ``Catalog`` element of every catalog by its name."""
    parameters: Scope = field(default_factory=dict)
    """Global parameters with their values."""
    catalogs_used: dict[str, None] = field(default_factory=dict)
    """``catalog/entry`` in the order in which they were met."""
    elements: int = 0
    """Those that were read so far."""
    _document: ScenarioDocument | None = None
    _open: tuple[str, ...] = ()

    def read(self, document: ScenarioDocument, overrides: Mapping[str, Value]) -> ScenarioElement:
        """The whole file, its global parameters overridden."""
        self._document = document
        rule = element_rules()[document.kind]
        if document.minor < rule.since:
            line = document.root.sourceline
            self.mistakes.add(document.path, line, f"a {rule.name} is since 1.{rule.since}")
        return self._element(document.root, rule, {}, dict(overrides), top=True)

    def _say(self, node: Any, words: str) -> None:
        assert self._document is not None
        self.mistakes.add(self._document.path, node.sourceline or 1, words)

    def _element(
        self, node: Any, rule: ElementRule, scope: Scope, overrides: Scope, top: bool = False
    ) -> ScenarioElement:
        assert self._document is not None
        self.elements += 1
        if self.elements > PLACED_ELEMENTS_MAX:
            words = f"more than {PLACED_ELEMENTS_MAX} elements with those of catalog entries"
            raise ValueError(f"{self._document.path}:{node.sourceline or 1}: {words}")
        if rule.name in REFUSED:
            self._say(node, f"{node.tag} is refused: {REFUSED[rule.name]}")
        declared = node.find("ParameterDeclarations")
        if declared is not None and "ParameterDeclarations" in rule.children:
            scope = {**scope, **self._declarations(declared, scope, overrides)}
            if top:
                self.parameters = scope
        elif overrides:
            self._unknown_overrides(node, overrides, {})
        values = self._values(node, rule, scope)
        children = tuple(self._children(node, rule, scope))
        text = (node.text or "").strip()
        if text and not rule.has_text:
            self._say(node, f"{node.tag} takes no text, '{text[:40]}' was given")
        target = self._entry(node, values, scope) if rule.name == "CatalogReference" else None
        file, line = self._document.path, node.sourceline or 1
        return ScenarioElement(node.tag, rule.name, values, children, text, file, line, target)

    def _values(self, node: Any, rule: ElementRule, scope: Scope) -> dict[str, Value]:
        assert self._document is not None
        minor, values = self._document.minor, dict[str, Value]()
        for key, text in node.attrib.items():
            attribute = rule.attributes.get(key)
            if attribute is None:
                if key.replace(_XSI, "xsi:") in IGNORED and node.getparent() is None:
                    continue
                hint = "; " + suggest(key, list(rule.attributes))
                self._say(node, f"{node.tag} has no attribute {key}{hint}")
            elif attribute.since > minor:
                words = f"is since version 1.{attribute.since}, this file says 1.{minor}"
                self._say(node, f"attribute {key} of {node.tag} {words}")
            else:
                try:
                    values[key] = value_of(text, attribute.type_name, scope, minor)
                except ValueError as error:
                    self._say(node, f"{key} of {node.tag}: {error}")
        for attribute in rule.attributes.values():
            if not attribute.optional and attribute.name not in node.attrib:
                self._say(node, f"{node.tag} lacks its attribute {attribute.name}")
        return values

    def _children(self, node: Any, rule: ElementRule, scope: Scope) -> list[ScenarioElement]:
        assert self._document is not None
        minor, children, counts = self._document.minor, list[ScenarioElement](), dict[str, int]()
        for child in node:
            if self.mistakes.full:
                return children
            known = rule.children.get(child.tag)
            if known is None:
                hint = "; " + suggest(child.tag, list(rule.children))
                self._say(child, f"{node.tag} has no element {child.tag}{hint}")
                continue
            counts[child.tag] = counts.get(child.tag, 0) + 1
            since = max(known.since, element_rules()[known.type_name].since)
            if since > minor:
                words = f"is since version 1.{since}, this file says 1.{minor}"
                self._say(child, f"element {child.tag} {words}")
                continue
            if counts[child.tag] == 2 and not known.many:
                self._say(child, f"{node.tag} has a second {child.tag}, one is allowed")
            children.append(self._element(child, element_rules()[known.type_name], scope, {}))
        self._count(node, rule, counts)
        return children

    def _count(self, node: Any, rule: ElementRule, counts: dict[str, int]) -> None:
        chosen = {name for _, names in rule.choices for name in names}
        for optional, names in rule.choices:
            present = [name for name in names if name in counts]
            if len(present) > 1:
                self._say(node, f"{node.tag} has {' and '.join(present)}, one of them is allowed")
            elif not present and not optional:
                self._say(node, f"{node.tag} needs one of {', '.join(names)}")
        for child in rule.children.values():
            count = counts.get(child.name, 0)
            if child.name not in chosen and count < child.least:
                self._say(node, f"{node.tag} lacks {_wanted(child)}")

    def _declarations(self, node: Any, scope: Scope, overrides: Scope) -> Scope:
        """Values of declared parameters; each may use those before it."""
        assert self._document is not None
        values: Scope = {}
        for declaration in node.findall("ParameterDeclaration"):
            name, text = declaration.get("name", ""), declaration.get("value", "")
            kind = PARAMETER_TYPES.get(declaration.get("parameterType", ""))
            if name in values:
                self._say(declaration, f"parameter {name} is declared twice")
            if kind is None:
                continue  # said where the element is read
            try:
                if name in overrides:
                    values[name] = convert(overrides[name], kind, MINOR_MAX)
                else:
                    values[name] = value_of(text, kind, {**scope, **values}, MINOR_MAX)
                self._constraints(declaration, values[name], kind, {**scope, **values})
            except ValueError as error:
                values.setdefault(name, _neutral(kind))
                self._say(declaration, f"parameter {name}: {error}")
        self._unknown_overrides(node, overrides, values)
        return values

    def _unknown_overrides(self, node: Any, overrides: Scope, values: Scope) -> None:
        for name in overrides:
            if name not in values:
                hint = "; " + suggest(name, list(values))
                self._say(node, f"parameter {name} is assigned but not declared{hint}")

    def _constraints(self, node: Any, value: Value, kind: str, scope: Scope) -> None:
        """At least one group of constraints must hold, and every constraint in it."""
        groups = node.findall("ConstraintGroup")
        if not groups:
            return
        for group in groups:
            holds = True
            for constraint in group.findall("ValueConstraint"):
                limit = value_of(constraint.get("value", ""), kind, scope, MINOR_MAX)
                holds = holds and compare(value, constraint.get("rule", ""), limit)
            if holds:
                return
        words = " or ".join(
            " and ".join(f"{c.get('rule')} {c.get('value')}" for c in group) for group in groups
        )
        raise ValueError(f"{value} breaks its constraint: {words}")

    def _entry(self, node: Any, values: dict[str, Value], scope: Scope) -> ScenarioElement | None:
        """The catalog entry that a reference names."""
        assert self._document is not None
        catalog, entry = str(values.get("catalogName", "")), str(values.get("entryName", ""))
        if not catalog or not entry:
            return None
        if catalog not in self.catalogs:
            known = ", ".join(sorted(self.catalogs)) or "none"
            self._say(node, f"catalog '{catalog}' is in no folder of CatalogLocations ({known})")
            return None
        document, root = self.catalogs[catalog]
        item = next((item for item in root if item.get("name") == entry), None)
        if item is None:
            hint = "; " + suggest(entry, [str(item.get("name")) for item in root])
            self._say(node, f"catalog '{catalog}' ({document.path}) has no entry '{entry}'{hint}")
            return None
        key = f"{catalog}/{entry}"
        if key in self._open or len(self._open) >= CATALOG_DEPTH_MAX:
            chain = " -> ".join([*self._open, key])
            self._say(node, f"catalog entries refer to each other in a circle: {chain}")
            return None
        if item.tag not in element_rules()["Catalog"].children:
            return None  # said where the catalog is checked
        self.catalogs_used[key] = None
        assigned = self._assignments(node, scope)
        before = self._document, self._open
        self._document, self._open = document, (*self._open, key)
        try:
            return self._element(item, element_rules()[item.tag], {}, assigned)
        finally:
            self._document, self._open = before

    def _assignments(self, node: Any, scope: Scope) -> Scope:
        assigned: Scope = {}
        for assignment in node.iterfind("ParameterAssignments/ParameterAssignment"):
            name = assignment.get("parameterRef", "")
            if name in assigned:
                self._say(assignment, f"parameter {name} is assigned twice")
            try:
                assigned[name] = value_of(assignment.get("value", ""), "s", scope, MINOR_MAX)
            except ValueError:
                continue  # said where the element is read
        return assigned


def compare(value: Value, rule: str, limit: Value) -> bool:
    """Whether a value stands in ``rule`` to ``limit``; an unknown rule holds."""
    a, b = value, limit
    match rule:
        case "equalTo":
            return a == b
        case "notEqualTo":
            return a != b
    if isinstance(a, str) or isinstance(b, str):
        a, b = str(a), str(b)  # date and time: ISO text sorts by time
        return {"lessThan": a < b, "greaterThan": a > b}.get(rule, (a <= b) == ("less" in rule))
    match rule:
        case "lessThan":
            return a < b
        case "greaterThan":
            return a > b
        case "lessOrEqual":
            return a <= b
        case "greaterOrEqual":
            return a >= b
    return True


def _neutral(kind: str) -> Value:
    values: dict[str, Value] = {"s": "", "b": False, "t": "1970-01-01T00:00:00", "d": 1.0}
    return values.get(kind, 1)


def _wanted(child: ChildRule) -> str:
    return child.name if child.least == 1 else f"{child.least} elements {child.name}"
