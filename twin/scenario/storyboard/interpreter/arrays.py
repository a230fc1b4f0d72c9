"""The tables of programs and the states of slots on a device, as structs that kernels take."""

from __future__ import annotations

import numpy as np
import warp as wp

from twin.scenario.storyboard.player.columns import (
    HISTORY_MAX,
    SCRATCH_REALS,
    SCRATCH_WHOLES,
    TRANSITIONS_MAX,
    ConditionState,
    Real,
    SlotColumn,
    Whole,
)
from twin.scenario.storyboard.player.tables import ProgramTables

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class ProgramArrays:
    """The arrays of ``ProgramTables``, see there; make it with :func:`program_arrays`."""

    programs: wp.array2d(dtype=wp.int32)
    entity_reals: wp.array2d(dtype=wp.float64)
    entity_wholes: wp.array2d(dtype=wp.int32)
    elements: wp.array2d(dtype=wp.int32)
    triggers: wp.array2d(dtype=wp.int32)
    conditions: wp.array2d(dtype=wp.int32)
    watchers: wp.array2d(dtype=wp.int32)
    visits: wp.array(dtype=wp.int32)
    instances: wp.array2d(dtype=wp.int32)
    actor_instances: wp.array(dtype=wp.int32)
    reals: wp.array(dtype=wp.float64)
    wholes: wp.array(dtype=wp.int32)
    trajectories: wp.array2d(dtype=wp.int32)
    pieces: wp.array2d(dtype=wp.float64)
    routes: wp.array2d(dtype=wp.int32)
    leg_roads: wp.array(dtype=wp.int32)
    leg_reals: wp.array2d(dtype=wp.float64)
    variables: wp.array(dtype=wp.float64)
    models: wp.array2d(dtype=wp.float64)
    clocks: wp.array(dtype=wp.float64)
    controllers: wp.array2d(dtype=wp.int32)
    delays: wp.array2d(dtype=wp.float64)
    phases: wp.array2d(dtype=wp.int32)
    phase_ends: wp.array2d(dtype=wp.float64)
    signals: wp.array2d(dtype=wp.int32)
    shown: wp.array2d(dtype=wp.float64)


@wp.struct
class PlayArrays:
    """What changes while slots run, apart from poses; make it with :func:`play_arrays`."""

    slots: wp.array2d(dtype=wp.int32)
    """[S, :class:`SlotColumn`]."""
    element_states: wp.array2d(dtype=wp.int32)
    """``ElementState``; -1: its parent has not started."""
    element_runs: wp.array2d(dtype=wp.int32)
    element_causes: wp.array2d(dtype=wp.int64)
    """Entities that triggered an event, a bit each."""
    element_skips: wp.array2d(dtype=wp.int32)
    """1: an event was skipped when its trigger was last true."""
    conditions: wp.array3d(dtype=wp.int32)
    """[S, C, :class:`ConditionState`]."""
    condition_causes: wp.array2d(dtype=wp.int64)
    """Entities that fulfil an expression, a bit each."""
    histories: wp.array3d(dtype=wp.int32)
    """Steps of the latest changes, by count of changes modulo ``HISTORY_MAX``."""
    instance_states: wp.array2d(dtype=wp.int32)
    instance_reals: wp.array3d(dtype=wp.float64)
    instance_wholes: wp.array3d(dtype=wp.int32)
    variables: wp.array2d(dtype=wp.float64)
    phases: wp.array2d(dtype=wp.int32)
    """Phase of each controller of signals, counted from its first; -1: not begun."""
    phase_steps: wp.array2d(dtype=wp.int32)
    """Step at which somebody last put it into a phase; 0: nobody has."""
    phase_ways: wp.array2d(dtype=wp.float64)
    """Time since its cycle began at that step [s]."""
    transitions: wp.array3d(dtype=wp.int32)
    """Step, element, transition; [S, 1024, 3]."""


@wp.struct
class BodyArrays:
    """Poses and motions of the entities of all slots; make it with :func:`body_arrays`."""

    reals: wp.array3d(dtype=wp.float64)
    """[S, N, :class:`Real`]."""
    wholes: wp.array3d(dtype=wp.int32)
    """[S, N, :class:`Whole`]."""


def program_arrays(tables: ProgramTables, device: wp.Device) -> ProgramArrays:
    """The arrays of ``tables`` on a device."""
    arrays = ProgramArrays()
    for name, rows in (
        *((name, getattr(tables, name)) for name in _SAME),
        ("leg_roads", np.ascontiguousarray(tables.leg_wholes[:, 0])),
    ):
        kind = wp.int32 if rows.dtype == np.int32 else wp.float64
        filled = rows if rows.size else np.zeros((1, *rows.shape[1:]), rows.dtype)
        setattr(arrays, name, wp.array(filled, dtype=kind, device=device))
    return arrays


_SAME = (
    *("programs", "entity_reals", "entity_wholes", "elements", "triggers", "conditions"),
    *(
        "watchers",
        "visits",
        "instances",
        "actor_instances",
        "reals",
        "wholes",
        "trajectories",
        "pieces",
    ),
    *("routes", "leg_reals", "variables", "models", "clocks"),
    *("controllers", "delays", "phases", "phase_ends", "signals", "shown"),
)


def play_arrays(slots: int, most: dict[str, int], device: wp.Device) -> PlayArrays:
    """States of slots that run nothing."""

    def wholes(*shape: int) -> wp.array:
        return wp.zeros((slots, *shape), dtype=wp.int32, device=device)

    def reals(*shape: int) -> wp.array:
        return wp.zeros((slots, *shape), dtype=wp.float64, device=device)

    play = PlayArrays()
    play.slots = wholes(len(SlotColumn))
    play.element_states = wholes(most["elements"])
    play.element_runs = wholes(most["elements"])
    play.element_causes = wp.zeros((slots, most["elements"]), dtype=wp.int64, device=device)
    play.element_skips = wholes(most["elements"])
    play.conditions = wholes(most["conditions"], len(ConditionState))
    play.condition_causes = wp.zeros((slots, most["conditions"]), dtype=wp.int64, device=device)
    play.histories = wholes(most["histories"], HISTORY_MAX)
    play.instance_states = wholes(most["instances"])
    play.instance_reals = reals(most["instances"], SCRATCH_REALS)
    play.instance_wholes = wholes(most["instances"], SCRATCH_WHOLES)
    play.variables = reals(most["variables"])
    play.phases = wholes(most["controllers"])
    play.phase_steps = wholes(most["controllers"])
    play.phase_ways = reals(most["controllers"])
    play.transitions = wholes(TRANSITIONS_MAX, 3)
    return play


def body_arrays(slots: int, entities: int, device: wp.Device) -> BodyArrays:
    """Entities at the origin, invisible."""
    bodies = BodyArrays()
    bodies.reals = wp.zeros((slots, entities, len(Real)), dtype=wp.float64, device=device)
    bodies.wholes = wp.zeros((slots, entities, len(Whole)), dtype=wp.int32, device=device)
    return bodies
