"""Slots of a rig: the attempt that runs in each, what a tick has brought, and how cases end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from msgspec import structs

from schemas.files.judging import JudgeRecord
from schemas.identity import stack_name
from schemas.messages import (
    COST_NAME_CHARS_MAX,
    COST_NAMES_MAX,
    Command,
    Episode,
    PerceptionCost,
    Tick,
)
from schemas.verdict import is_pass
from schemas.wire.control import Lease
from schemas.wire.interventions import RecordedAction

if TYPE_CHECKING:
    from twin.kpi.table import KpiTable
    from twin.rig.attempt_record import AttemptRecord
    from twin.rig.interventions.journal import InterventionJournal
    from twin.rig.pacing import Paced
    from twin.rig.stack_output import Kept
    from twin.sensors.data import SensorData


@dataclass(frozen=True, slots=True)
class Finished:
    """A case that has ended; its slot is inactive already."""

    slot: int
    outcome: str
    """``verdict``, or ``failed``: the case cannot be simulated, deterministically."""
    verdict: str
    """Empty when failed."""
    reasons: list[str]
    scalars: dict[str, float | int | None]
    table: KpiTable
    names: dict[str, str] = field(default_factory=dict)
    """Scalars that are names, :data:`schemas.files.kpi.NAMES`."""
    record: JudgeRecord | None = None
    """Record that a judge needs beside the rows."""

    @property
    def passed(self) -> bool:
        """See :func:`schemas.verdict.is_pass`."""
        return is_pass(self.outcome, self.verdict)


@dataclass(eq=False, slots=True)
class Slot:
    """An attempt in a slot of a rig, from its start to its end."""

    index: int
    lease: Lease
    started_s: float
    """Time at which the slot took the attempt [s]."""
    name: str = field(init=False)
    """Name by which the stack knows the case."""
    replay: list[RecordedAction] = field(default_factory=list)
    """Actions from the journal of an earlier attempt, to be repeated."""
    fresh: bool = True
    """The stack has not seen it yet."""
    held: bool = False
    """Whether it stands still in sim time, while others go on."""
    perception: PerceptionCost | None = None
    """Sum so far; None: the stack reported none."""
    rig_wall_s: float = 0.0
    """Share of the rig's wall time so far [s]."""

    def __post_init__(self) -> None:
        self.name = stack_name(self.lease.case)

    def perceived(self, cost: PerceptionCost | None) -> None:
        """Add what perception cost in one tick; what a foreign stack says and can be no time or
        number is left out."""
        if cost is None or not (0 <= cost.frames < 1e6 and 0.0 <= cost.wall_s < 1e6):
            return
        total = self.perception
        stages, limited = {}, {}
        frames, wall_s = cost.frames, cost.wall_s
        if total is not None:
            frames, wall_s = total.frames + frames, total.wall_s + wall_s
            stages, limited = dict(total.stages), dict(total.limited)
        _add_times(stages, cost.stages)
        _add_times(limited, cost.limited)
        self.perception = structs.replace(
            total or cost, frames=frames, wall_s=wall_s, stages=stages, limited=limited
        )


def _add_times(total: dict[str, float], times: dict[str, float]) -> None:
    """Add what a stack tells by names; names and numbers that can be none are left out."""
    for name, time_s in times.items():
        fits = name in total or len(total) < COST_NAMES_MAX
        if fits and len(name) <= COST_NAME_CHARS_MAX and 0.0 <= time_s < 1e6:
            total[name] = total.get(name, 0.0) + time_s


@dataclass(slots=True)
class SlotEnd:
    """How an attempt ended; every listener adds what it knows."""

    finished: Finished
    wall_s: float
    """Wall time from when its slot took it to its end [s]."""
    changes: int = 0
    """Interventions that changed what was simulated; if any, it is no result of the case."""
    journal: InterventionJournal | None = None
    """Journal of these interventions, to be ended with the result."""
    paced: Paced | None = None
    """Course of the attempt by the wall clock; None: in lockstep."""
    record: AttemptRecord | None = None
    """Drive record, to be ended with the result."""
    output: Kept | None = None
    """Output of the stack; None: that is on another host."""


@dataclass(slots=True)
class RigTick:
    """One tick of a rig, as far as it has come."""

    message: Tick
    """Tick message as the stack gets it."""
    sensed: dict[str, SensorData]
    """Readings of all slots by sensor message."""
    told: dict[str, SensorData]
    """Readings as far as the stack may know them, also those that it does not look at."""
    episodes: list[Episode]
    """Cases that the stack sees for the first time."""
    shown: dict[str, SensorData] = field(default_factory=dict)
    """Those of ``told`` that the stack looks at, and gets."""
    answered: list[Command | None] = field(default_factory=list)
    """The stack's commands, one per slot."""
    commands: list[Command | None] = field(default_factory=list)
    """Commands in force: the stack's, as interventions have changed them."""


class Slots:
    """Slots of a rig, free ones included."""

    def __init__(self, count: int) -> None:
        self._slots: list[Slot | None] = [None] * count

    def __len__(self) -> int:
        return len(self._slots)

    def __iter__(self) -> Iterator[Slot]:
        """Attempts in order of their slots, those that stand still as well."""
        return (slot for slot in self._slots if slot is not None)

    @property
    def running(self) -> list[Slot]:
        """Attempts that take part in the next tick."""
        return [slot for slot in self if not slot.held]

    @property
    def held(self) -> list[Slot]:
        """Attempts that stand still."""
        return [slot for slot in self if slot.held]

    @property
    def free(self) -> list[int]:
        """Indices of the slots without an attempt."""
        return [index for index, slot in enumerate(self._slots) if slot is None]

    @property
    def by_index(self) -> list[Slot | None]:
        """Attempts that take part in the next tick, by slot."""
        return [None if slot is None or slot.held else slot for slot in self._slots]

    def __getitem__(self, index: int) -> Slot | None:
        return self._slots[index]

    def take(self, slot: Slot) -> None:
        """An attempt begins in a free slot."""
        assert self._slots[slot.index] is None, f"slot {slot.index} is taken"
        self._slots[slot.index] = slot

    def leave(self, slot: Slot) -> None:
        """An attempt is over: its slot is free."""
        self._slots[slot.index] = None

    def of_token(self, token: int) -> Slot | None:
        """Attempt with a token."""
        return next((slot for slot in self if slot.lease.token == token), None)
