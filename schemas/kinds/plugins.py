"""Plug-ins: other distributions that bring kinds, which a campaign uses and a worker must have."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from schemas.kinds.batch_system import batch_systems
from schemas.kinds.bridge import bridges
from schemas.kinds.kpi import kpi_kinds
from schemas.kinds.registry import Kinds, Plugin
from schemas.kinds.scenario import NamesFamily, kind_of, scenario_kinds
from schemas.kinds.sensor import sensor_kinds
from schemas.words import plain

_LACK_CHARS_MAX = 200
"""Longest reason why a plug-in cannot be used: a conductor keeps no longer ones."""


def used_plugins(scenario: NamesFamily, sensors: Iterable[str], bridge: str) -> dict[str, str]:
    """The distributions that bring what a campaign names; those that are merely installed are not
    among them.

    Args:
        scenario: with its family, whose KPIs may come from further distributions.
        sensors: names of those of the vehicle's own sensors that it has a section of.
        bridge: its name.

    Returns:
        name of a distribution -> version, sorted; those that are not shipped.
    """
    named: list[tuple[Kinds[Any], Iterable[str]]] = [
        (scenario_kinds(), (scenario.type,)),
        (kpi_kinds(), kind_of(scenario).kpis),
        (sensor_kinds(), sensors),
        (bridges(), (bridge,)),
    ]
    found = {kinds.brought[n] for kinds, names in named for n in names if n in kinds.brought}
    return {plugin.name: plugin.version for plugin in sorted(found)}


def lacking_plugins() -> dict[str, str]:
    """Plug-ins of this installation that bring something that cannot be used, with the reason in a
    line, as workers announce it."""
    return {plugin_lack(who.name): plain(why, _LACK_CHARS_MAX) for who, why in _broken()}


def plugin_lack(name: str) -> str:
    """What a worker lacks that cannot use the plug-in ``name``."""
    return f"plug-in {name}"


def _broken() -> Iterator[tuple[Plugin, str]]:
    tables: tuple[Kinds[Any], ...] = (
        *(scenario_kinds(), kpi_kinds(), sensor_kinds()),
        *(bridges(), batch_systems()),
    )
    for kinds in tables:
        for name, why in kinds.broken.items():
            if name in kinds.brought:
                yield kinds.brought[name], why
