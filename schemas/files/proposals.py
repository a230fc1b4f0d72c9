"""``proposed.jsonl``: what a search has proposed, beside the campaign file of its run.

A line per generation: the values of its cases as JSON, cases by parameters. It only grows, and the
campaign file says how many lines belong to it and their digest, so the two are always of one
moment.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from schemas.files.regular_file import read_regular
from schemas.files.yaml_file import YamlError
from schemas.sections.search import Rows, text_of
from schemas.validation import convert_all

FILE_NAME = "proposed.jsonl"
PROPOSED_BYTES_MAX = 256 << 20
"""Largest file that is read: a hundred thousand cases of forty parameters take a fifth."""


class ProposedFile(Struct, frozen=True, forbid_unknown_fields=True):
    """What stands in ``search.proposed`` in place of the values."""

    generations: int
    """Lines that belong to the campaign file."""
    sha256: str
    """Digest of these lines."""


def encode_proposed(proposed: Sequence[Rows]) -> bytes:
    """Content of the file."""
    return "".join(f"{text_of(rows)}\n" for rows in proposed).encode()


def beside(content: dict[str, Any], data: bytes) -> dict[str, Any]:
    """The content of a campaign whose proposed values lie in a file of this content; coordinates
    are in ``search.json``."""
    search = content["search"]
    named = ProposedFile(len(search["proposed"]), hashlib.sha256(data).hexdigest())
    section = {**search, "first": [], "proposed": msgspec.to_builtins(named)}
    return {**content, "search": section}


def with_proposals(content: Any, folder: Path, shown: str) -> Any:
    """The content of a campaign file with the values that lie beside it; any other as it is.

    Args:
        content: of the file.
        folder: where it lies.
        shown: its name in messages.

    Raises:
        YamlError: they are missing, or not those that the file names.
    """
    search = content.get("search") if isinstance(content, dict) else None
    if not isinstance(search, dict) or not isinstance(named := search.get("proposed"), dict):
        return content
    told, mistakes = convert_all(named, ProposedFile)
    if told is None:
        raise YamlError(f"{shown}: search.proposed.{mistakes[0].path}: {mistakes[0].message}")
    path = folder / FILE_NAME
    try:
        lines = read_regular(path, PROPOSED_BYTES_MAX).splitlines(keepends=True)
    except OSError as error:
        raise YamlError(f"{path}: {error.strerror or error}; it belongs to {shown}") from None
    lines = lines[: max(0, told.generations)]
    if hashlib.sha256(b"".join(lines)).hexdigest() != told.sha256:
        raise YamlError(f"{path}: is not what {shown} names; copy both from one run")
    try:
        proposed = [line.decode().rstrip("\n") for line in lines]
    except UnicodeDecodeError:
        raise YamlError(f"{path}: is no text in UTF-8; copy it from its run again") from None
    return {**content, "search": {**search, "proposed": proposed}}
