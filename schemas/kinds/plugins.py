"""Plug-ins: other distributions that bring kinds, which a campaign uses and a worker must have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from schemas.escape import escape
from schemas.kinds.batch_system import batch_systems
from schemas.kinds.bridge import bridges
from schemas.kinds.kpi import kpi_kinds
from schemas.kinds.perception import perception_kinds
from schemas.kinds.registry import Kinds, Plugin
from schemas.kinds.sampler import sampler_kinds
from schemas.kinds.scenario import NamesFamily, kind_of, scenario_kinds
from schemas.kinds.sensor import sensor_kinds

_LACK_CHARS_MAX = 200
"""Longest reason why a plug-in cannot be used: a conductor keeps no longer ones."""


class ForeignKind(NamedTuple):
    """A kind of another distribution that a campaign uses."""

    key: str
    """Key of the campaign that names it."""
    plugin: Plugin
    implementation: str
    """``module:attribute``; empty: it needs none."""


def foreign_kinds(
    scenario: NamesFamily,
    sensors: Iterable[str],
    bridge: str,
    perceptions: Iterable[str],
    samplers: Iterable[str] = (),
) -> Iterator[ForeignKind]:
    """The kinds of other distributions that a campaign names; what is merely installed is not among
    them.

    Args:
        scenario: with its family, whose KPIs may come from further distributions.
        sensors: names of those of the vehicle's own sensors that it has a section of.
        bridge: its name.
        perceptions: types of its perception variants.
        samplers: name of what proposes its cases, if it is a search.

    """
    named: list[tuple[Kinds[Any], str, Iterable[str]]] = [
        (scenario_kinds(), "scenario.type", (scenario.type,)),
        (kpi_kinds(), "scenario.type", kind_of(scenario).kpis),
        (sensor_kinds(), "sensors", sorted(sensors)),
        (bridges(), "autonomy.bridge", (bridge,)),
        (perception_kinds(), "autonomy.perception", perceptions),
        (sampler_kinds(), "search.sampler", samplers),
    ]
    for kinds, key, names in named:
        for name in names:
            kind = kinds.get(name)
            if kind is not None and name in kinds.brought:
                at = f"{key}.{name}" if key == "sensors" else key
                yield ForeignKind(at, kinds.brought[name], kind.implementation)


def lacking_plugins() -> dict[str, str]:
    """Plug-ins of this installation that bring something that cannot be used, with the reason in a
    line, as workers announce it."""
    return {plugin_lack(who.name): escape(why, _LACK_CHARS_MAX) for who, why in _broken()}


def plugin_lack(name: str) -> str:
    """What a worker lacks that cannot use the plug-in ``name``."""
    return f"plug-in {name}"


def _broken() -> Iterator[tuple[Plugin, str]]:
    tables: tuple[Kinds[Any], ...] = (
        *(scenario_kinds(), kpi_kinds(), sensor_kinds()),
        *(bridges(), batch_systems(), perception_kinds()),
        sampler_kinds(),
    )
    for kinds in tables:
        for name, why in kinds.broken.items():
            if name in kinds.brought:
                yield kinds.brought[name], why
