"""Parsers that run in a process apart, and what that process is asked."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from twin.world.apart.checks import Check


@dataclass(frozen=True, slots=True)
class Parser:
    """A function that reads a file, and what it may answer."""

    entry: str
    """``module:function``, called with the path of the file and what is asked beside it, if that is
    anything; a ``ValueError`` of it is the user's line."""
    check: Check
    """What it may answer."""
    failed: str
    """Words of the line if it comes to no answer, after the file's name."""

    def function(self) -> Callable[..., Any]:
        """The function; imports its module."""
        module, _, name = self.entry.partition(":")
        found: Callable[..., Any] = getattr(importlib.import_module(module), name)
        return found


def parser_of(name: str) -> Parser:
    """The parser that is called ``module:ATTRIBUTE``; imports its module."""
    module, _, attribute = name.partition(":")
    found: object = getattr(importlib.import_module(module), attribute)
    assert isinstance(found, Parser), name
    return found


class ReadRequest(msgspec.Struct, forbid_unknown_fields=True):
    """What the process is asked."""

    asks: list[tuple[str, str, bytes]]
    """Parser as ``module:ATTRIBUTE``, path of a file, and what is asked beside it."""
    cpu_s: int
    """Processor time that it may take [s]."""
    memory_bytes: int
    """Address space that it may take [bytes]."""
