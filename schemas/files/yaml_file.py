"""YAML as people expect it: duplicate keys are errors, ``05:00`` and ``no`` stay text."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from schemas.escape import escape
from schemas.files.regular_file import read_regular

FILE_BYTES_MAX = 4 << 20
"""Largest YAML file that is read [bytes]."""

VALUES_MAX = 500_000
"""Most values in a YAML file, its aliases written out."""

_OPEN = -1


class YamlError(ValueError):
    """The file cannot be read as YAML; the message is one line and names the place."""

    def __init__(self, words: str) -> None:
        super().__init__(escape(words))


class _Loader(yaml.SafeLoader):
    """PyYAML follows YAML 1.1, where ``11:00`` is 660 and ``no`` is false; YAML 1.2 has neither."""

    nodes = 0
    """Number of nodes composed so far; each takes a kilobyte."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self.nodes += 1
        if self.nodes > VALUES_MAX:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem=f"more than {VALUES_MAX} values", problem_mark=mark)
        node = super().compose_node(parent, index)
        if node is not None:
            _check_tag(node)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str | int | float | bool | None):
                raise yaml.MarkedYAMLError(
                    problem="a mapping key must be a plain value", problem_mark=key_node.start_mark
                )
            if key in keys:
                raise yaml.MarkedYAMLError(
                    problem=f"key '{key}' appears twice", problem_mark=key_node.start_mark
                )
            keys.add(key)
        return super().construct_mapping(node, deep=deep)


_PATTERNS: dict[str, re.Pattern[str]] = {}
"""What a scalar of each tag looks like, with and without its tag."""

_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", "~nN"),
    ("tag:yaml.org,2002:int", r"[-+]?(0|[1-9][0-9_]*)", "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?([0-9][0-9_]*\.[0-9_]*|\.[0-9]+|[0-9][0-9_]*(?=[eE]))([eE][-+]?[0-9]+)?"
        r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+0123456789.",
    ),
):
    _PATTERNS[_tag] = re.compile(f"^(?:{_pattern})$")
    _Loader.add_implicit_resolver(_tag, _PATTERNS[_tag], list(_first))
# The empty scalar ("key:") is null in YAML 1.2 as well.
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"^$"), [""])


class _Dumper(yaml.SafeDumper):
    """Quotes what :class:`_Loader` would take for something else than text, as a digest such as
    ``196784039e57``, besides what YAML 1.1 would."""


_Dumper.yaml_implicit_resolvers = {
    first: [*yaml.SafeDumper.yaml_implicit_resolvers.get(first, ()), *resolvers]
    for first, resolvers in {
        **yaml.SafeDumper.yaml_implicit_resolvers,
        **_Loader.yaml_implicit_resolvers,
    }.items()
}

_PREFIX = "tag:yaml.org,2002:"
_TAGS = ("str", "int", "float", "bool", "null", "map", "seq")
"""Tags that a file may write; the others are types that no file of ours holds."""
_LIKE = {"int": ("int",), "float": ("float", "int"), "bool": ("bool",), "null": ("null",)}
"""Tags whose pattern a scalar of a tag has to match."""


def _check_tag(node: yaml.Node) -> None:
    """Refuse what ``!!tag`` makes of a value if the value alone would not be read as that.

    PyYAML's constructors take it for granted that a scalar fits its tag.
    """
    name = node.tag.removeprefix(_PREFIX)
    if not node.tag.startswith(_PREFIX) or name not in _TAGS:
        shown = f"!!{name}" if node.tag.startswith(_PREFIX) else name
        refused, allowed = f"tag '{shown}'", ", ".join(f"!!{tag}" for tag in _TAGS)
        raise yaml.MarkedYAMLError(
            problem=f"{refused}; leave it out, or one of {allowed}", problem_mark=node.start_mark
        )
    kind = {"map": yaml.MappingNode, "seq": yaml.SequenceNode}.get(name, yaml.ScalarNode)
    patterns = [_PATTERNS[f"{_PREFIX}{like}"] for like in _LIKE.get(name, ())]
    fits = not patterns or any(pattern.match(str(node.value)) for pattern in patterns)
    if not isinstance(node, kind) or not fits:
        shown = f"'{node.value[:80]}'" if isinstance(node, yaml.ScalarNode) else "a list or mapping"
        raise yaml.MarkedYAMLError(
            problem=f"{shown} is no !!{name}; leave the tag out", problem_mark=node.start_mark
        )


def parse_yaml(text: str, name: str) -> Any:
    """Parse one YAML document; ``name`` (a path) appears in the error."""
    try:
        return _constructed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise YamlError(f"{name}{where}: {error.problem or 'not valid YAML'}") from None
    except RecursionError:
        raise YamlError(f"{name}: not valid YAML: nested too deeply") from None
    except (yaml.YAMLError, ValueError) as error:
        raise YamlError(f"{name}: not valid YAML: {' '.join(str(error).split())}") from None


def line_of(text: str, path: str) -> int | None:
    """Line of a YAML document in which a key stands, from 1; None: it is not in it.

    Args:
        text: of a document that :func:`parse_yaml` takes.
        path: keys with dots between, items by number, as in ``cases[2].weather``; keys may have
            dots in them themselves.
    """
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
    except (yaml.YAMLError, RecursionError):
        return None
    finally:
        loader.dispose()
    line = None
    while path and node is not None:
        step = _step(node, path)
        if step is None:
            return None
        line, node, path = step
    return line


def _step(node: yaml.Node, path: str) -> tuple[int, yaml.Node, str] | None:
    """Line of the first key or item of ``path``, what stands there, and the rest of the path."""
    if isinstance(node, yaml.SequenceNode):
        item = re.match(r"\[(\d+)\]\.?", path)
        if item is None or int(item[1]) >= len(node.value):
            return None
        found = node.value[int(item[1])]
        return found.start_mark.line + 1, found, path[item.end() :]
    if not isinstance(node, yaml.MappingNode):
        return None
    fitting = [
        (key, value)
        for key, value in node.value
        if path == key.value or path.startswith((f"{key.value}.", f"{key.value}["))
    ]
    if not fitting:
        return None
    key, value = max(fitting, key=lambda pair: len(pair[0].value))
    return key.start_mark.line + 1, value, path[len(key.value) :].removeprefix(".")


def _constructed(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count(node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count(node: yaml.Node, counts: dict[int, int]) -> int:
    """Values below ``node`` with its aliases written out: ten lines of them can mean billions, and
    whoever walks through the document meets each."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    known = counts.get(id(node))
    if known is not None:
        if known == _OPEN:
            problem = "an alias that holds itself; write it out"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        return known
    counts[id(node)] = _OPEN
    total = 1
    for child in node.value:
        parts = child if isinstance(child, tuple) else (child,)
        total += sum(_count(part, counts) for part in parts)
        if total > VALUES_MAX:
            problem = f"more than {VALUES_MAX} values, aliases written out"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    counts[id(node)] = total
    return total


def load_yaml(path: Path) -> Any:
    """Read one YAML document from ``path``.

    Raises:
        YamlError: missing, unreadable, no regular file, too large, not UTF-8 or not YAML.
    """
    return parse_yaml(read_yaml_text(path), str(path))


def read_yaml_text(path: Path) -> str:
    """The text of a YAML file, which :func:`parse_yaml` reads.

    Raises:
        YamlError: missing, unreadable, no regular file, too large or not UTF-8.
    """
    try:
        return read_regular(path, FILE_BYTES_MAX).decode()
    except OSError as error:
        raise YamlError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise YamlError(f"{path}: not UTF-8 text (byte {error.start})") from None


def dump_yaml(data: Any, width: int = 100) -> str:
    """YAML text with keys in the given order, in lines of about ``width`` characters."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width)
