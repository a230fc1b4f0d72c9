"""Plain data -> frozen Structs, reporting every mistake with its path and what is allowed.

``msgspec.convert`` stops at the first mistake; people fixing a file want all of them at once.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeVar, cast

import msgspec
from msgspec import inspect

from schemas.escape import escape

T = TypeVar("T")


MISTAKES_MAX = 100
"""Number of mistakes at which a file is looked through no further."""

_SHOWN_MAX = 60


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake: where it is (``scenario.duration_s``) and one sentence about it."""

    path: str
    message: str

    def line(self, name: str) -> str:
        """The one line a user sees; ``name`` is the file."""
        where = f"{name}: {self.path}" if self.path else name
        return escape(f"{where}: {self.message}")


def convert_all(data: Any, type_: type[T]) -> tuple[T | None, list[Mistake]]:
    """Convert plain ``data`` to ``type_``.

    Returns:
        The value and no mistakes, or None and at least one mistake.
    """
    try:
        mistakes = _check(data, _info(cast(Hashable, type_)), "")
    except RecursionError:
        mistakes = [Mistake("", "nested too deeply")]
    if len(mistakes) > MISTAKES_MAX:
        mistakes[MISTAKES_MAX:] = [Mistake("", "and more; correct these first")]
    if mistakes:
        return None, mistakes
    try:
        return msgspec.convert(data, type_), []
    except msgspec.ValidationError as error:  # a check in a Struct's __post_init__
        return None, [Mistake("", _sentence(error))]


# Looking a campaign's type up takes ten times as long as checking a campaign.
_info = lru_cache(maxsize=256)(inspect.type_info)


def _check(data: Any, info: inspect.Type, path: str) -> list[Mistake]:
    if isinstance(info, inspect.Metadata):
        return _check(data, info.type, path)
    if isinstance(info, inspect.UnionType):
        return _check_union(data, info, path)
    if isinstance(info, inspect.StructType):
        return _check_struct(data, info, path)
    if isinstance(info, inspect.DictType):
        if not isinstance(data, dict):
            return [Mistake(path, f"given {_shown(data)}, expected a mapping of names to values")]
        mistakes: list[Mistake] = []
        for key, value in data.items():
            if len(mistakes) > MISTAKES_MAX:
                break
            mistakes += _check(key, info.key_type, _join(path, str(key)))
            mistakes += _check(value, info.value_type, _join(path, str(key)))
        for limit, word in ((info.min_length, "at least"), (info.max_length, "at most")):
            if limit is not None and (len(data) - limit) * (1 if word == "at most" else -1) > 0:
                mistakes.append(Mistake(path, f"given {len(data)} names, {word} {limit} allowed"))
        return mistakes
    if isinstance(info, inspect.ListType | inspect.VarTupleType):
        if not isinstance(data, list | tuple):
            return [Mistake(path, f"given {_shown(data)}, expected a list")]
        plain = _plain_types(info.item_type)
        mistakes = []
        for index, item in enumerate(data):
            # A hundred thousand values of an axis are not looked at one by one.
            if type(item) not in plain:
                mistakes += _check(item, info.item_type, f"{path}[{index}]")
                if len(mistakes) > MISTAKES_MAX:
                    break
        if not mistakes and info.min_length is not None and len(data) < info.min_length:
            mistakes.append(
                Mistake(path, f"given an empty list, at least {info.min_length} needed")
            )
        return mistakes
    return _check_scalar(data, info, path)


def _plain_types(info: inspect.Type) -> set[type]:
    """Python types of which every value is allowed (floats may be infinite, so never them)."""
    members = info.types if isinstance(info, inspect.UnionType) else (info,)
    return {
        type_
        for kind, type_ in (
            (inspect.BoolType, bool),
            (inspect.IntType, int),
            (inspect.StrType, str),
        )
        if any(member == kind() for member in members)
    }


def _check_union(data: Any, info: inspect.UnionType, path: str) -> list[Mistake]:
    if data is None and any(isinstance(t, inspect.NoneType) for t in info.types):
        return []
    members = [t for t in info.types if not isinstance(t, inspect.NoneType)]
    if len(members) == 1:
        return _check(data, members[0], path)
    tagged = {m.tag: m for m in members if isinstance(m, inspect.StructType) and m.tag_field}
    if len(tagged) == len(members) and isinstance(data, dict):
        name = next(iter(tagged.values())).tag_field or ""
        choice = data.get(name)
        if isinstance(choice, str) and choice in tagged:
            return _check(data, tagged[choice], path)
        kinds = ", ".join(str(tag) for tag in tagged)
        return [Mistake(_join(path, name), f"given {_shown(choice)}, allowed: {kinds}")]
    if any(not _check(data, member, path) for member in members):
        return []
    allowed = " or ".join(dict.fromkeys(_allowed(member) for member in members))
    finite = "" if not isinstance(data, float) or math.isfinite(data) else ", finite"
    return [Mistake(path, f"given {_shown(data)}, allowed: {allowed}{finite}")]


def _check_struct(data: Any, info: inspect.StructType, path: str) -> list[Mistake]:
    if not isinstance(data, dict):
        names = ", ".join(field.encode_name for field in info.fields)
        return [Mistake(path, f"given {_shown(data)}, expected a mapping with keys {names}")]
    fields = {field.encode_name: field for field in info.fields}
    mistakes: list[Mistake] = []
    for key, value in data.items():
        if len(mistakes) > MISTAKES_MAX:
            break
        where = _join(path, str(key))
        if key == info.tag_field:
            if value != info.tag:
                mistakes.append(Mistake(where, f"given {_shown(value)}, allowed: {info.tag}"))
        elif not fields:
            continue  # what no key can be of: it says below why it is refused
        elif key not in fields:
            mistakes.append(Mistake(where, f"unknown key; {suggest(str(key), list(fields))}"))
        else:
            mistakes += _check(value, fields[key].type, where)
    for name, field in fields.items():
        if field.required and name not in data:
            mistakes.append(Mistake(_join(path, name), f"missing; {_allowed(field.type)} needed"))
    if not mistakes:
        try:
            msgspec.convert(data, info.cls)
        except msgspec.ValidationError as error:
            mistakes.append(Mistake(path, _sentence(error)))
    return mistakes


def _check_scalar(data: Any, info: inspect.Type, path: str) -> list[Mistake]:
    if isinstance(data, float) and not math.isfinite(data):
        return [Mistake(path, f"given {data}, allowed: {_allowed(info)}, finite")]
    try:
        msgspec.convert(data, _rebuild(info))
    except msgspec.ValidationError:
        hint = ""
        if isinstance(info, inspect.LiteralType) and isinstance(data, str):
            close = difflib.get_close_matches(data, [str(v) for v in info.values], n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
        return [Mistake(path, f"given {_shown(data)}, allowed: {_allowed(info)}{hint}")]
    return []


def _rebuild(info: inspect.Type) -> Any:
    """The Python annotation of a scalar ``info``."""
    if isinstance(info, inspect.LiteralType):
        return Literal[tuple(info.values)]
    if isinstance(info, inspect.IntType | inspect.FloatType):
        kind: Any = int if isinstance(info, inspect.IntType) else float
        meta = {
            k: getattr(info, k) for k in ("gt", "ge", "lt", "le") if getattr(info, k) is not None
        }
        return Annotated[kind, msgspec.Meta(**meta)] if meta else kind
    if isinstance(info, inspect.StrType):
        text = {
            k: getattr(info, k)
            for k in ("min_length", "max_length", "pattern")
            if getattr(info, k) is not None
        }
        return Annotated[str, msgspec.Meta(**text)] if text else str
    if isinstance(info, inspect.BoolType):
        return bool
    if isinstance(info, inspect.NoneType):
        return None
    return Any


def _allowed(info: inspect.Type) -> str:
    """What is allowed, in words."""
    if isinstance(info, inspect.Metadata):
        return _allowed(info.type)
    if isinstance(info, inspect.LiteralType):
        return ", ".join(str(v) for v in info.values)
    if isinstance(info, inspect.IntType | inspect.FloatType):
        noun = "a whole number" if isinstance(info, inspect.IntType) else "a number"
        signs = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))
        limits = [
            f"{sign} {getattr(info, k):g}" for k, sign in signs if getattr(info, k) is not None
        ]
        return f"{noun} {' and '.join(limits)}".strip()
    if isinstance(info, inspect.StrType):
        return f"text matching {info.pattern}" if info.pattern else "text"
    if isinstance(info, inspect.BoolType):
        return "true or false"
    if isinstance(info, inspect.UnionType):
        return " or ".join(_allowed(t) for t in info.types)
    if isinstance(info, inspect.NoneType):
        return "nothing"
    if isinstance(info, inspect.StructType | inspect.DictType):
        return "a mapping"
    if isinstance(info, inspect.ListType | inspect.VarTupleType):
        return "a list"
    return "a value"


def suggest(given: str, allowed: list[str]) -> str:
    """``did you mean 'x'? allowed: ...`` for a misspelt name."""
    return f"{did_you_mean(given, allowed)}allowed: {', '.join(allowed)}"


def did_you_mean(given: str, names: Iterable[str]) -> str:
    """``did you mean 'x'?`` and a space for a misspelt name; empty: nothing is like it."""
    close = difflib.get_close_matches(given, names, n=1)
    return f"did you mean '{close[0]}'? " if close else ""


def _sentence(error: msgspec.ValidationError) -> str:
    """A ``__post_init__`` message without msgspec's position suffix."""
    sentence = str(error).split(" - at `")[0]
    before, _, key = sentence.partition("Object contains unknown field `")
    return sentence if before or not key else f"unknown key '{key.rstrip('`')}'; there is none"


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _shown(data: Any) -> str:
    if data is None:
        return "nothing"
    if isinstance(data, str):
        text = repr(data[:_SHOWN_MAX])
    elif isinstance(data, list | tuple):
        text = str(data[:_SHOWN_MAX])
    else:
        text = str(data)
    return text if len(text) <= 60 else f"{text[:57]}..."
