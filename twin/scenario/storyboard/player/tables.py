"""Storyboard programs as flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.base.errors import UsageError
from twin.scenario.storyboard.player.columns import (
    CONDITIONS_MAX,
    ELEMENTS_MAX,
    ENTITIES_MAX,
    INSTANCES_MAX,
    POOL_MAX,
    ConditionColumn,
    ControllerColumn,
    ElementColumn,
    EntityColumn,
    EntityWhole,
    InstanceColumn,
    ProgramColumn,
)
from twin.scenario.storyboard.player.instances import ProgramInstances, program_instances
from twin.scenario.storyboard.player.kinds import condition_code
from twin.scenario.storyboard.player.layout import flatten
from twin.scenario.storyboard.program.conditions import ElementStateCondition, Trigger
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.scenario.storyboard.program.places import FixedPosition, Position, RoadRoute, Trajectory
from twin.scenario.storyboard.program.program import DriverModel, ElementKind, Program
from twin.scenario.storyboard.program.record import ProgramRecord
from twin.scenario.storyboard.program.signals import SignalController

PIECE_COLUMNS = 20
"""Start, length, cubics of x, y, z and heading, start time, duration; see ``TrajectoryPiece``."""
MODEL_COLUMNS = 10
"""Fields of a driver model in their order."""
COUNTED = (
    *("entities", "elements", "conditions", "instances", "variables", "histories", "levels"),
    "controllers",
)
"""What of programs decides how large the states of a slot are."""


@dataclass(frozen=True, slots=True)
class ProgramTables:
    """Make it with :func:`pack_programs`; rows of all programs, one after the other."""

    programs: np.ndarray
    """int32 [P, :class:`ProgramColumn`]."""
    entity_reals: np.ndarray
    """float64 [N, :class:`EntityColumn`]."""
    entity_wholes: np.ndarray
    """int32 [N, :class:`EntityWhole`]."""
    elements: np.ndarray
    """int32 [L, :class:`ElementColumn`]."""
    triggers: np.ndarray
    """First condition and how many, int32 [G, 2]."""
    conditions: np.ndarray
    """int32 [C, :class:`ConditionColumn`]."""
    watchers: np.ndarray
    """Conditions on states of elements: condition and element, int32 [W, 2]."""
    visits: np.ndarray
    """Elements that may wait for something, in their order, int32 [U]."""
    instances: np.ndarray
    """int32 [I, :class:`InstanceColumn`]."""
    actor_instances: np.ndarray
    """Instances by actor, in the order of the storyboard, int32 [A]."""
    reals: np.ndarray
    """Floats of actions, conditions and start places, float64."""
    wholes: np.ndarray
    """Their integers, int32."""
    trajectories: np.ndarray
    """First piece, how many, closed, timed, in the actor's axes; int32 [T, 5]."""
    pieces: np.ndarray
    """float64 [K, 20]."""
    routes: np.ndarray
    """First leg, how many, closed; int32 [R, 3]."""
    leg_wholes: np.ndarray
    """Road and lane, int32 [Q, 2]."""
    leg_reals: np.ndarray
    """From and to, float64 [Q, 2]."""
    variables: np.ndarray
    """First values, float64 [V]."""
    models: np.ndarray
    """float64 [M, 10]."""
    clocks: np.ndarray
    """Times of day of the environments, NaN: none, float64 [E]."""
    controllers: np.ndarray
    """int32 [B, :class:`ControllerColumn`]."""
    delays: np.ndarray
    """Of controllers: delay and length of the cycle, float64 [B, 2]."""
    phases: np.ndarray
    """First signal and how many, int32 [H, 2]."""
    phase_ends: np.ndarray
    """Number of the name, and end since the cycle began, float64 [H, 2]."""
    signals: np.ndarray
    """Variables that phases set, int32 [G, 1]."""
    shown: np.ndarray
    """What they are set to, float64 [G, 1]."""
    most: dict[str, int]
    """Largest count of each of :data:`COUNTED`."""


def pack_programs(programs: Sequence[Program]) -> ProgramTables:
    """The tables of programs.

    Raises:
        UsageError: a program is larger than a limit.
    """
    if not programs:
        raise UsageError("a player needs at least one program")
    packer = _Packer()
    for program in programs:
        packer.add(program)
    return packer.tables()


class _Packer:
    """Rows of all programs so far."""

    def __init__(self) -> None:
        self.rows: dict[str, list[tuple[float, ...]]] = {
            name: []
            for name in [
                "programs",
                "entity_reals",
                "entity_wholes",
                "elements",
                "triggers",
                "conditions",
                "watchers",
                "instances",
                "trajectories",
                "pieces",
                "routes",
                "leg_wholes",
                "leg_reals",
                "models",
                "controllers",
                "delays",
                "phases",
                "phase_ends",
                "signals",
                "shown",
            ]
        }
        self.actors: list[int] = []
        self.visits: list[int] = []
        self.reals: list[float] = []
        self.wholes: list[int] = []
        self.variables: list[float] = []
        self.clocks: list[float] = []
        self.most = dict.fromkeys(COUNTED, 1)

    def add(self, program: Program) -> None:
        """Append a program."""
        rows = self.rows
        header = dict.fromkeys(ProgramColumn, 0)
        header[ProgramColumn.ENTITY] = len(rows["entity_reals"])
        header[ProgramColumn.ENTITIES] = self._limited(program, "entities", ENTITIES_MAX)
        header[ProgramColumn.ELEMENT] = len(rows["elements"])
        header[ProgramColumn.ELEMENTS] = self._limited(program, "elements", ELEMENTS_MAX)
        header[ProgramColumn.CONDITION] = len(rows["conditions"])
        header[ProgramColumn.TRIGGER] = len(rows["triggers"])
        header[ProgramColumn.STATES] = len(rows["watchers"])
        header[ProgramColumn.INSTANCE] = len(rows["instances"])
        header[ProgramColumn.VARIABLE] = len(self.variables)
        header[ProgramColumn.VARIABLES] = len(program.variables)
        header[ProgramColumn.TRAJECTORY] = len(rows["trajectories"])
        header[ProgramColumn.ROUTE] = len(rows["routes"])
        header[ProgramColumn.MODEL] = len(rows["models"])
        header[ProgramColumn.ENVIRONMENT] = len(self.clocks)
        header[ProgramColumn.CONTROLLER] = len(rows["controllers"])
        header[ProgramColumn.CONTROLLERS] = len(program.controllers)
        instances = program_instances(program)
        self._add_instances(program, instances)
        header[ProgramColumn.INSTANCES] = len(instances.rows)
        header[ProgramColumn.INITS] = instances.inits
        histories = self._add_elements(program, instances, header)
        visits = _visits(program)
        header[ProgramColumn.VISIT] = len(self.visits)
        header[ProgramColumn.VISIT_COUNT] = len(visits)
        self.visits += visits
        header[ProgramColumn.CONDITIONS] = len(rows["conditions"]) - header[ProgramColumn.CONDITION]
        header[ProgramColumn.STATE_COUNT] = len(rows["watchers"]) - header[ProgramColumn.STATES]
        self._add_entities(program.entities, instances)
        self._add_ways(program)
        self.variables += [variable.value for variable in program.variables]
        self.clocks += [
            float("nan") if place.time_of_day_s is None else place.time_of_day_s
            for place in program.environments
        ]
        rows["models"] += [_model_row(model) for model in program.models]
        for controller in program.controllers:
            self._add_controller(controller)
        rows["programs"].append(tuple(header[column] for column in ProgramColumn))
        self._count(program, header, instances, histories)

    def tables(self) -> ProgramTables:
        """All rows as arrays."""
        rows = self.rows
        return ProgramTables(
            programs=_wholes(rows["programs"], len(ProgramColumn)),
            entity_reals=_reals(rows["entity_reals"], len(EntityColumn)),
            entity_wholes=_wholes(rows["entity_wholes"], len(EntityWhole)),
            elements=_wholes(rows["elements"], len(ElementColumn)),
            triggers=_wholes(rows["triggers"], 2),
            conditions=_wholes(rows["conditions"], len(ConditionColumn)),
            watchers=_wholes(rows["watchers"], 2),
            visits=np.array(self.visits, np.int32),
            instances=_wholes(rows["instances"], len(InstanceColumn)),
            actor_instances=np.array(self.actors, np.int32),
            reals=np.array(self.reals, np.float64),
            wholes=np.array(self.wholes, np.int32),
            trajectories=_wholes(rows["trajectories"], 5),
            pieces=_reals(rows["pieces"], PIECE_COLUMNS),
            routes=_wholes(rows["routes"], 3),
            leg_wholes=_wholes(rows["leg_wholes"], 2),
            leg_reals=_reals(rows["leg_reals"], 2),
            variables=np.array(self.variables, np.float64),
            models=_reals(rows["models"], MODEL_COLUMNS),
            clocks=np.array(self.clocks, np.float64),
            controllers=_wholes(rows["controllers"], len(ControllerColumn)),
            delays=_reals(rows["delays"], 2),
            phases=_wholes(rows["phases"], 2),
            phase_ends=_reals(rows["phase_ends"], 2),
            signals=_wholes(rows["signals"], 1),
            shown=_reals(rows["shown"], 1),
            most=self.most,
        )

    def _limited(self, program: Program, name: str, most: int) -> int:
        count = len(getattr(program, name))
        if count > most:
            raise UsageError(f"program '{program.name}': {count} {name}; at most {most} are played")
        return count

    def _pool(self, record: object, *, before: tuple[float, ...] = ()) -> tuple[int, int]:
        """Append a record's columns; where they begin."""
        reals, wholes = flatten(record)
        first = (len(self.reals) + len(before), len(self.wholes))
        self.reals += [*before, *reals]
        self.wholes += wholes
        if max(len(self.reals), len(self.wholes)) > POOL_MAX:
            raise UsageError(f"actions and conditions need more than {POOL_MAX} numbers")
        return first

    def _add_instances(self, program: Program, instances: ProgramInstances) -> None:
        if len(instances.rows) > INSTANCES_MAX:
            raise UsageError(
                f"program '{program.name}': {len(instances.rows)} actions, counted once for each "
                f"actor; at most {INSTANCES_MAX} are played"
            )
        pools: dict[int, tuple[int, int]] = {}
        for row in instances.rows:
            if id(row.action) not in pools:
                pools[id(row.action)] = self._pool(row.action)
            place = pools[id(row.action)]
            self.rows["instances"].append(
                (row.kind, row.actor, row.element, *place, row.domains, row.level, row.always)
            )

    def _add_elements(
        self, program: Program, instances: ProgramInstances, header: dict[ProgramColumn, int]
    ) -> int:
        """Elements with their triggers; how many histories their conditions need."""
        ends = _subtree_ends(program)
        histories = 0
        for index, element in enumerate(program.elements):
            triggers = []
            for trigger in (element.start, element.stop):
                number = -1
                if trigger is not None:
                    number = len(self.rows["triggers"]) - header[ProgramColumn.TRIGGER]
                    histories = self._add_trigger(trigger, index, histories, header)
                triggers.append(number)
            first, count = instances.by_element.get(index, (0, 0))
            self.rows["elements"].append(
                (
                    *(element.kind, element.parent, ends[index], *triggers),
                    *(element.priority, element.executions_max, first, count),
                    int(element.triggering_actors),
                )
            )
        return histories

    def _add_trigger(
        self, trigger: Trigger, owner: int, histories: int, header: dict[ProgramColumn, int]
    ) -> int:
        rows = self.rows["conditions"]
        base = header[ProgramColumn.CONDITION]
        first = len(rows) - base
        for number, group in enumerate(trigger.groups):
            for condition in group:
                ring = -1
                if condition.delay_s > 0.0:
                    ring, histories = histories, histories + 1
                place = self._pool(condition.expression, before=(condition.delay_s,))
                if isinstance(condition.expression, ElementStateCondition):
                    watcher = (len(rows) - base, condition.expression.element)
                    self.rows["watchers"].append(watcher)
                entities = (len(self.wholes), len(condition.entities))
                self.wholes += condition.entities
                kind = condition_code(condition.expression)
                how = (kind, number, condition.edge, int(condition.all_entities))
                rows.append((*how, *entities, *place, ring, owner))
        self.rows["triggers"].append((first, len(rows) - base - first))
        return histories

    def _add_entities(
        self, entities: Sequence[StoryboardEntity], instances: ProgramInstances
    ) -> None:
        for index, entity in enumerate(entities):
            box = entity.box
            self.rows["entity_reals"].append(
                (
                    *(box.centre_x_m, box.centre_y_m, box.length_m, box.width_m),
                    *(entity.speed_max_mps, entity.acceleration_max_mps2),
                    *(entity.deceleration_max_mps2, box.height_m),
                    *(entity.hitch_x_m or 0.0, entity.coupler_x_m or 0.0),
                )
            )
            start = entity.start or FixedPosition(0.0, 0.0, 0.0, 0.0)
            holder = self._pool(_Start(start))
            mine = [k for k, row in enumerate(instances.rows) if row.body == index]
            tows = next((k for k, other in enumerate(entities) if other.tractor == index), -1)
            self.rows["entity_wholes"].append(
                (
                    *(entity.category, int(entity.ego), int(entity.start is not None), *holder),
                    *(len(self.actors), len(mine), tows, entity.tractor),
                )
            )
            self.actors += mine

    def _add_ways(self, program: Program) -> None:
        for trajectory in program.trajectories:
            first = (len(self.rows["pieces"]), len(trajectory.pieces))
            kinds = (trajectory.closed, trajectory.timed, trajectory.from_actor)
            self.rows["trajectories"].append((*first, *map(int, kinds)))
            self.rows["pieces"] += _piece_rows(trajectory)
        for route in program.routes:
            self.rows["routes"].append(
                (len(self.rows["leg_reals"]), len(route.legs), int(route.closed))
            )
            self._add_legs(route)

    def _add_legs(self, route: RoadRoute) -> None:
        self.rows["leg_wholes"] += [(leg.road, leg.lane) for leg in route.legs]
        self.rows["leg_reals"] += [(leg.from_s_m, leg.to_s_m) for leg in route.legs]

    def _add_controller(self, controller: SignalController) -> None:
        rows = self.rows
        count = len(controller.phases)
        rows["controllers"].append((controller.variable, len(rows["phases"]), count))
        end_s = 0.0
        for phase in controller.phases:
            end_s += phase.duration_s
            rows["phases"].append((len(rows["signals"]), len(phase.states)))
            rows["phase_ends"].append((phase.name, end_s))
            rows["signals"] += [(state.variable,) for state in phase.states]
            rows["shown"] += [(state.value,) for state in phase.states]
        rows["delays"].append((controller.delay_s, end_s))

    def _count(
        self,
        program: Program,
        header: dict[ProgramColumn, int],
        instances: ProgramInstances,
        histories: int,
    ) -> None:
        conditions = header[ProgramColumn.CONDITIONS]
        if conditions > CONDITIONS_MAX:
            raise UsageError(
                f"program '{program.name}': {conditions} conditions; at most {CONDITIONS_MAX} are "
                "played"
            )
        for name, count in (
            ("entities", len(program.entities)),
            ("elements", len(program.elements)),
            ("conditions", conditions),
            ("instances", len(instances.rows)),
            ("variables", len(program.variables)),
            ("histories", histories),
            ("levels", instances.levels),
            ("controllers", len(program.controllers)),
        ):
            self.most[name] = max(self.most[name], count)


class _Start(ProgramRecord, frozen=True):
    place: Position


def _subtree_ends(program: Program) -> list[int]:
    """For each element the one behind the last of its descendants."""
    ends = list(range(1, len(program.elements) + 1))
    for index in range(len(program.elements) - 1, 0, -1):
        parent = program.elements[index].parent
        if not 0 <= parent < index:
            raise UsageError(
                f"program '{program.name}': element {index} has parent {parent}; a parent stands "
                "before its children"
            )
        ends[parent] = max(ends[parent], ends[index])
    return ends


def _visits(program: Program) -> list[int]:
    """Elements with a trigger, groups that may run again, and the storyboard."""
    return [
        index
        for index, element in enumerate(program.elements)
        if element.start is not None
        or element.stop is not None
        or index == 0
        or (element.kind is ElementKind.GROUP and element.executions_max > 1)
    ]


def _piece_rows(trajectory: Trajectory) -> list[tuple[float, ...]]:
    return [
        (
            *(piece.start_s_m, piece.length_m, *piece.x, *piece.y, *piece.z, *piece.heading),
            *(piece.start_time_s, piece.duration_s),
        )
        for piece in trajectory.pieces
    ]


def _model_row(model: DriverModel) -> tuple[float, ...]:
    return (
        *(model.desired_speed_mps, model.time_gap_s, model.gap_min_m, model.acceleration_mps2),
        *(model.deceleration_mps2, float(model.exponent), model.politeness),
        *(model.change_threshold_mps2, model.deceleration_safe_mps2, model.change_duration_s),
    )


def _reals(rows: list[tuple[float, ...]], columns: int) -> np.ndarray:
    return np.array(rows, np.float64).reshape(len(rows), columns)


def _wholes(rows: list[tuple[float, ...]], columns: int) -> np.ndarray:
    return np.array(rows, np.int64).reshape(len(rows), columns).astype(np.int32)
