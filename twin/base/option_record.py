"""Options that several commands share: declared once, as the fields of a dataclass."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command for typer: a parameter whose type is a dataclass becomes one option per field.

    The fields are annotated as typer wants its parameters, and stand in ``--help`` where the
    parameter stands.
    """
    declared = inspect.signature(command, eval_str=True).parameters.values()
    records = {option.name: option.annotation for option in declared if _is_record(option)}

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        for name, record in records.items():
            fields = {field.name: values.pop(field.name) for field in dataclasses.fields(record)}
            values[name] = record(**fields)
        command(**values)

    parameters = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for option in declared
        for parameter in (_options(option.annotation) if option.name in records else (option,))
    ]
    wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return wrapped


def _is_record(parameter: inspect.Parameter) -> bool:
    return isinstance(parameter.annotation, type) and dataclasses.is_dataclass(parameter.annotation)


def _options(record: Any) -> Iterator[inspect.Parameter]:
    """The fields of a record as parameters."""
    hints = get_type_hints(record, include_extras=True)
    for field in dataclasses.fields(record):
        needed = field.default is dataclasses.MISSING
        yield inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            annotation=hints[field.name],
            default=inspect.Parameter.empty if needed else field.default,
        )
