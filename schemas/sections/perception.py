"""Perception variants of a campaign: what the stack sees with, each a file type of its own.

Their keys stand in their declarations (:mod:`schemas.kinds.perception`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct, defstruct, structs, to_builtins

from schemas.kinds.perception import TAG, perception_kind, perception_kinds
from schemas.kinds.perceptions.ground_truth import GroundTruthPerception as GroundTruthPerception
from schemas.kinds.perceptions.network import NetworkPerception as NetworkPerception
from schemas.kinds.perceptions.network import is_integer as is_integer
from schemas.kinds.perceptions.network import is_model_path as is_model_path


def _unusable(name: str, reason: str) -> type[Struct]:
    """Stands for a variant that cannot be used: who asks for it is told why."""

    def refuse(_self: Struct) -> None:
        raise ValueError(reason)

    return defstruct("Unusable", [], tag_field=TAG, tag=name, namespace={"__post_init__": refuse})


if TYPE_CHECKING:
    Perception = GroundTruthPerception | NetworkPerception
    """A perception variant."""
else:
    _KINDS = perception_kinds()
    Perception = reduce(
        or_,
        [
            *(kind.config for kind in _KINDS.declared),
            *(_unusable(n, why) for n, why in _KINDS.broken.items() if _KINDS.get(n) is None),
        ],
    )


def file_fields(variant: Perception) -> Mapping[str, str]:
    """Keys of ``variant`` that name files by path, and the paths."""
    return perception_kind(variant).files(variant)


def what_is_loaded(variant: Perception) -> dict[str, Any]:
    """Keys of ``variant`` that decide what is loaded, and its type."""
    chosen = perception_kind(variant).chosen
    keys: dict[str, Any] = to_builtins(variant)
    return {key: value for key, value in keys.items() if key not in chosen}


def with_absolute_files(variants: Mapping[str, Perception], folder: Path) -> dict[str, Perception]:
    """The variants of a campaign file in ``folder``; their files' paths, relative to it, begin at
    the root: workers may run in another folder."""
    return {
        name: structs.replace(
            variant,
            **{key: str((folder / path).absolute()) for key, path in file_fields(variant).items()},
        )
        for name, variant in variants.items()
    }
