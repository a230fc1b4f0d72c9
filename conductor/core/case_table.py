"""The cases of a campaign as columns: what they share is kept once, on disk and in memory.

A hundred thousand cases differ in a few fields; as rows they would take 50 MB of journal and a
second to read. Cases that come out of a table share their equal sections.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import msgspec
from msgspec import UNSET, Struct

from schemas.campaign import CASES_MAX
from schemas.case import Case, RigSpec, Variation
from schemas.first_stage import case_of, is_flat

_VARYING = msgspec.structs.fields(Variation)
_RIG = "rig"
"""Column of the rigs; the others are fields of the variations."""
_FIELDS = {_RIG: RigSpec, **{field.encode_name: field.type for field in _VARYING}}
_OPTIONAL = {field.encode_name for field in _VARYING if not field.required}
"""Fields that tables of older versions may lack."""
_UNSET = {field.encode_name for field in _VARYING if field.default is UNSET}
"""Fields that a case may lack: null there, and without a column where all lack it."""


class CaseColumn(Struct, frozen=True):
    """One field of all cases."""

    values: list[Any]
    """The different values, as plain data."""
    index: list[int] = []
    """Per case the position in ``values``; empty: one value for all, or one each in order."""


class CaseTable(Struct, frozen=True):
    """All cases of a campaign in their order."""

    count: int
    columns: dict[str, CaseColumn]


def pack(cases: Sequence[Case]) -> CaseTable:
    """Cases -> table."""
    return CaseTable(
        count=len(cases),
        columns={
            _RIG: _column([case.rig for case in cases]),
            **{
                field.encode_name: _column([getattr(case.variation, field.name) for case in cases])
                for field in _VARYING
                if not (
                    field.encode_name in _UNSET
                    and all(getattr(case.variation, field.name) is UNSET for case in cases)
                )
            },
        },
    )


def unpack(table: CaseTable) -> list[Case]:
    """Table -> cases.

    Raises:
        msgspec.ValidationError: a column does not hold what a case needs.
        AssertionError: a column is of another length.
    """
    if not 0 <= table.count <= CASES_MAX:
        raise AssertionError(f"a table of {table.count} cases, at most {CASES_MAX} are allowed")
    if is_flat(table.columns):
        names = [*table.columns]
        plain = [_values(table, name, table.columns[name].values) for name in names]
        return [case_of(dict(zip(names, row, strict=True))) for row in zip(*plain, strict=True)]
    columns = []
    names = [name for name in _FIELDS if name in table.columns or name not in _OPTIONAL]
    for name in names:
        type_ = _FIELDS[name] | None if name in _UNSET else _FIELDS[name]
        values = msgspec.convert(table.columns[name].values, list[type_])  # type: ignore[valid-type]
        if name in _UNSET:
            values = [UNSET if value is None else value for value in values]
        columns.append(_values(table, name, values))
    rigs, *varying = columns
    return [
        Case(rig=rig, variation=Variation(**dict(zip(names[1:], row, strict=True))))
        for rig, *row in zip(rigs, *varying, strict=True)
    ]


def _values(table: CaseTable, name: str, different: list[Any]) -> list[Any]:
    """The column ``name``, a value per case, of its different values."""
    index = table.columns[name].index
    if index:
        values = [different[i] for i in index]
    else:
        values = different * table.count if len(different) == 1 else different
    if len(values) != table.count:
        raise AssertionError(f"column {name}: {len(values)} of {table.count} cases")
    return values


def _column(values: list[Any]) -> CaseColumn:
    first = values[0]
    if all(value is first for value in values):
        return CaseColumn(values=_plain([first]))
    positions: dict[Hashable, int] = {}
    index = []
    unique: list[Any] = []
    keys: dict[int, Hashable] = {}  # equal sections are mostly one object
    for value in values:
        key = keys.get(id(value))
        if key is None:
            key = keys[id(value)] = _key(value)
        position = positions.setdefault(key, len(unique))
        if position == len(unique):
            unique.append(value)
        index.append(position)
    plain = _plain(unique)
    if len(unique) == 1 or index == list(range(len(values))):
        return CaseColumn(values=plain)
    return CaseColumn(values=plain, index=index)


def _plain(values: Sequence[Any]) -> list[Any]:
    plain: list[Any] = msgspec.to_builtins([None if value is UNSET else value for value in values])
    return plain


def _key(value: Any) -> Hashable:
    if value is UNSET:
        return None
    # 1, 1.0 and True are equal and not the same.
    if isinstance(value, str | int):
        return type(value), value
    return msgspec.json.encode(value, order="sorted")
