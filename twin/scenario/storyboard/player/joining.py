"""Tables of several programs, put together from those of each.

Packing a program costs a millisecond. A rig whose slots run hundreds of programs gets a new one
with every case: it packs that one alone, and what stands before it in the tables shifts its rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from twin.base.errors import UsageError
from twin.scenario.storyboard.player.columns import (
    POOL_MAX,
    ConditionColumn,
    ControllerColumn,
    EntityWhole,
    InstanceColumn,
    ProgramColumn,
)
from twin.scenario.storyboard.player.tables import COUNTED, ProgramTables

POINTERS: dict[str, dict[int, str]] = {
    "programs": {
        ProgramColumn.ENTITY: "entity_reals",
        ProgramColumn.ELEMENT: "elements",
        ProgramColumn.CONDITION: "conditions",
        ProgramColumn.INSTANCE: "instances",
        ProgramColumn.TRIGGER: "triggers",
        ProgramColumn.VARIABLE: "variables",
        ProgramColumn.TRAJECTORY: "trajectories",
        ProgramColumn.ROUTE: "routes",
        ProgramColumn.MODEL: "models",
        ProgramColumn.ENVIRONMENT: "clocks",
        ProgramColumn.STATES: "watchers",
        ProgramColumn.VISIT: "visits",
        ProgramColumn.CONTROLLER: "controllers",
    },
    "entity_wholes": {
        EntityWhole.START_REALS: "reals",
        EntityWhole.START_WHOLES: "wholes",
        EntityWhole.LIST: "actor_instances",
    },
    "conditions": {
        ConditionColumn.ENTITY: "wholes",
        ConditionColumn.REALS: "reals",
        ConditionColumn.WHOLES: "wholes",
    },
    "instances": {InstanceColumn.REALS: "reals", InstanceColumn.WHOLES: "wholes"},
    "trajectories": {0: "pieces"},
    "routes": {0: "leg_reals"},
    "controllers": {ControllerColumn.PHASE: "phases"},
    "phases": {0: "signals"},
}
"""Columns of tables that say where rows begin in a table of all programs, by table; all other
columns count from a program's first row."""
_ARRAYS = tuple(field.name for field in fields(ProgramTables) if field.name != "most")


def join_tables(parts: Sequence[ProgramTables]) -> ProgramTables:
    """The tables that :func:`twin.scenario.storyboard.player.tables.pack_programs` makes of all
    programs of ``parts``, which are tables that it made of some.

    Raises:
        UsageError: together they are larger than a limit.
    """
    joined: dict[str, Any] = {}
    firsts: dict[str, np.ndarray] = {}
    counts: dict[str, np.ndarray] = {}
    for name in _ARRAYS:
        arrays = [getattr(part, name) for part in parts]
        counts[name] = np.array([len(array) for array in arrays])
        firsts[name] = np.cumsum(counts[name]) - counts[name]
        joined[name] = np.concatenate(arrays)
    for name, columns in POINTERS.items():
        for column, table in columns.items():
            shifts = np.repeat(firsts[table], counts[name])
            joined[name][:, column] += shifts.astype(np.int32)
    if max(len(joined["reals"]), len(joined["wholes"])) > POOL_MAX:
        raise UsageError(f"actions and conditions need more than {POOL_MAX} numbers")
    most = {name: max(part.most[name] for part in parts) for name in COUNTED}
    return ProgramTables(**joined, most=most)
