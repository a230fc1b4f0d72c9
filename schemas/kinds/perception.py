"""The table of perception variants: what the reference stack may see with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

from msgspec import Struct

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.perception"
"""Entry points that bring perception variants."""

OURS = {"shipped": "schemas.kinds.perceptions:KINDS"}
"""Perception variants that are shipped; the same as in pyproject.toml."""

TAG = "type"
"""Key of a variant that names its kind."""


def _no_files(_variant: Any) -> Mapping[str, str]:
    return {}


def _never(_variant: Any) -> bool:
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceptionKind:
    """Declaration of a perception variant."""

    name: str
    """Name of the kind: ``type`` of a variant."""
    config: type[Struct]
    """Keys of a variant, with types, ranges, defaults and meanings; tagged with the name."""
    implementation: str
    """``module:attribute`` of what makes a :class:`devkit.perception.Perception` of a variant and a
    :class:`devkit.perception.Setting`."""
    told_truth: bool = False
    """The stack gets the boxes and the exact environment of the simulator."""
    files: Callable[[Any], Mapping[str, str]] = _no_files
    """Keys of a variant that name files by path, and the paths."""
    loaded: str = ""
    """Key that names what the stack loads onto its device: reckoned with the size of the variant's
    files, and tried before any case is leased. Empty: it loads nothing."""
    chosen: tuple[str, ...] = ()
    """Keys that only choose from what is seen: variants that differ in nothing else load the
    same."""
    shipped: Callable[[Any], Mapping[str, str]] = _no_files
    """What a variant names that comes with this package -> its path, from the packages' folder."""
    portable: Callable[[Any], bool] = _never
    """Whether what a variant sees has the same bits on every CPU and GPU."""
    packages: tuple[str, ...] = ()
    """Packages, without dots, that it imports and workers may be without."""
    installed_by: str = ""
    """What ``pip install`` takes to have them."""
    text: str = ""
    """What it sees with, in reports; empty: its name says so."""
    shown: tuple[str, ...] = ()
    """Keys that reports show even where they have their defaults."""


@cache
def perception_kinds() -> Kinds[PerceptionKind]:
    """All perception variants, the shipped ones first."""
    kinds = read_kinds(GROUP, PerceptionKind, OURS)
    broken, good = dict(kinds.broken), []
    for kind in kinds.declared:
        config = getattr(kind.config, "__struct_config__", None)
        if config is not None and (config.tag_field, config.tag) == (TAG, kind.name):
            good.append(kind)
            continue
        who = " ".join(kinds.brought[kind.name])
        broken[kind.name] = (
            f"{who}: perception '{kind.name}': its config {kind.config.__name__} is no struct with "
            f"tag_field='{TAG}' and tag='{kind.name}'"
        )
    return Kinds(tuple(good), broken, kinds.brought)


def lacking_perceptions() -> dict[str, str]:
    """Perception variants that cannot run in this installation, with what to do, in a line, as
    workers announce it."""
    lacks = {}
    for kind in perception_kinds().declared:
        lacking = [name for name in kind.packages if not find_spec(name)]
        if lacking:
            remedy = f"no package {', '.join(lacking)}: pip install '{kind.installed_by}'"
            lacks[perception_lack(kind.name)] = remedy
    return lacks


def perception_lack(name: str) -> str:
    """What a worker lacks that cannot run perception variants of the kind ``name``."""
    return f"perception {name}"


def perception_kind(variant: Struct) -> PerceptionKind:
    """The declaration of what ``variant`` is.

    Raises:
        ValueError: it is no perception variant.
    """
    kind = _by_config().get(type(variant))
    if kind is None:
        known = ", ".join(kind.name for kind in perception_kinds().declared)
        raise ValueError(f"perception {type(variant).__name__}: not known; allowed: {known}")
    return kind


@cache
def _by_config() -> dict[type[Struct], PerceptionKind]:
    return {kind.config: kind for kind in perception_kinds().declared}
