"""The keys of a file type, with type, range, default and meaning, derived from the type itself."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec import NODEFAULT, Struct
from msgspec import inspect as types


@dataclass(frozen=True, slots=True)
class FieldKey:
    """One key of a file."""

    path: str
    """``camera.width``; ``<name>`` stands for a name of one's own, ``[]`` for each of a list."""
    allowed: str
    """Type and range, or the values."""
    default: str
    """Default value; empty: the key must be given."""
    meaning: str


def keys_of(cls: type[Struct]) -> list[FieldKey]:
    """All keys of the file type ``cls`` in its order, nested ones below their section."""
    return list(_keys(cls, ""))


def markdown(keys: list[FieldKey]) -> str:
    """The keys as a Markdown table."""
    lines = ["| key | allowed | default | meaning |", "|---|---|---|---|"]
    for key in keys:
        default = f"`{key.default}`" if key.default else ""
        row = " | ".join((f"`{key.path}`", key.allowed, default, key.meaning))
        lines.append(f"| {row} |".replace("  ", " "))
    return "\n".join(lines) + "\n"


def _keys(cls: type[Struct], prefix: str) -> Iterator[FieldKey]:
    meanings = _meanings(cls)
    info = types.type_info(cls)
    assert isinstance(info, types.StructType)
    if isinstance(info.tag, str) and info.tag_field is not None:
        yield FieldKey(f"{prefix}{info.tag_field}", info.tag, info.tag, _first_line(cls))
    for field in info.fields:
        path = prefix + field.encode_name
        sections = list(_sections(field.type, path))
        allowed = "section" if sections and sections[0][1] == path else _allowed(field.type)
        default = "" if sections else _default(field)
        meaning = meanings.get(field.name) or (_first_line(sections[0][0]) if sections else "")
        yield FieldKey(path, allowed, default, meaning)
        for section, name in sections:
            yield from _keys(section, f"{name}.")


def _sections(kind: types.Type, path: str) -> Iterator[tuple[type[Struct], str]]:
    """File types below a key, with their paths."""
    if isinstance(kind, types.StructType):
        yield kind.cls, path
    elif isinstance(kind, types.DictType):
        yield from _sections(kind.value_type, f"{path}.<name>")
    elif isinstance(kind, types.ListType):
        yield from _sections(kind.item_type, f"{path}[]")
    elif isinstance(kind, types.UnionType):
        for member in kind.types:
            yield from _sections(member, path)


def _allowed(kind: types.Type) -> str:
    match kind:
        case types.LiteralType():
            return ", ".join(str(value) for value in kind.values)
        case types.BoolType():
            return "true, false"
        case types.IntType():
            return f"integer{_range(kind)}"
        case types.FloatType():
            return f"number{_range(kind)}"
        case types.ListType():
            return f"list of {_allowed(kind.item_type)}"
        case types.DictType():
            return f"map to {_allowed(kind.value_type)}"
        case types.StructType():
            return "section"
        case types.UnionType():
            if {type(member) for member in kind.types} == _PLAIN:
                return "value"
            plain = [member for member in kind.types if not isinstance(member, types.NoneType)]
            return " or ".join(dict.fromkeys(_allowed(member) for member in plain))
    return "text"


_PLAIN = {types.BoolType, types.IntType, types.FloatType, types.StrType}


def _range(kind: types.IntType | types.FloatType) -> str:
    low = kind.ge if kind.ge is not None else kind.gt
    high = kind.le if kind.le is not None else kind.lt
    above = "above " if kind.ge is None and kind.gt is not None else ""
    below = "below " if kind.le is None and kind.lt is not None else ""
    if low is not None and high is not None and high < 2**53:
        return f", {above}{low:g} to {below}{high:g}"
    if low is not None:
        return f", {above or 'from '}{low:g}"
    return "" if high is None else f", {below or 'up to '}{high:g}"


def _default(field: types.Field) -> str:
    value: Any = field.default
    if value is NODEFAULT:
        if field.default_factory is NODEFAULT:
            return ""
        value = field.default_factory()
    return msgspec.json.encode(value).decode()


def _first_line(cls: type[Struct]) -> str:
    text = inspect.cleandoc(cls.__doc__ or "").split("\n\n")[0]
    return text.replace("\n", " ").replace("``", "`")


def _meanings(cls: type[Struct]) -> dict[str, str]:
    """The strings below the fields in the source of ``cls`` and its bases, or of the classes that
    it was made of."""
    made_of: tuple[type[Struct], ...] = getattr(cls, "__sources__", ())
    if made_of:
        meanings = {k: v for source in made_of for k, v in _meanings(source).items()}
        return meanings | getattr(cls, "__meanings__", {})
    meanings = {}
    for base in cls.__bases__:
        if issubclass(base, Struct) and base is not Struct:
            meanings |= _meanings(base)
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    body = tree.body[0]
    assert isinstance(body, ast.ClassDef)
    for line, after in zip(body.body, body.body[1:], strict=False):
        if (
            isinstance(line, ast.AnnAssign)
            and isinstance(line.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
        ):
            text = inspect.cleandoc(after.value.value).replace("\n", " ")
            meanings[line.target.id] = text.replace("``", "`")
    return meanings
