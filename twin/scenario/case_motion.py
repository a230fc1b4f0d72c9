"""What moves the bodies that cases of a family bring, in all slots of a rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from schemas.case import Case
from twin.actors.motion import Placement
from twin.scenario.driver import LedPose, RobotLimits
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.things import Thing


class StartPose(NamedTuple):
    """Where the ego begins, and how fast."""

    x_m: float
    """World [m]."""
    y_m: float
    z_m: float
    yaw_rad: float
    speed_mps: float


class CaseTarget(NamedTuple):
    """What the trial of a case is about."""

    name: str
    hull: np.ndarray
    """Hull at the start [5]: x, y [m], yaw [rad], half length and width [m]."""


class CaseMotion(Protocol):
    """Bodies of all slots, from step to step; slots know nothing of one another."""

    count: int
    """Most bodies of a slot M."""
    actors: Sequence[Any]
    """Empty: no scene says where they are."""
    steps: int
    """Physics steps of a step."""

    @property
    def standing(self) -> np.ndarray:
        """int32 [M]; see :class:`twin.actors.motion.Motion`."""

    def begin(self, slot: int, case: Case) -> StartPose:
        """A case begins in a slot.

        Raises:
            ValueError: its files cannot be used; one line.
        """

    def alone(self, slot: int, time_s: float) -> StartPose:
        """Let a slot that has just begun go on to a time, its ego as the scenario says; where the
        ego is then."""

    def clear(self, slot: int) -> None:
        """Nobody is in a slot any more."""

    def hold(self, slot: int, *, held: bool) -> None:
        """A slot stands still, or goes on as it was."""

    def save(self, slot: int) -> dict[str, Any]:
        """What the bodies of a slot remember from step to step, copied.

        Raises:
            ValueError: it cannot be saved; one line.
        """

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on with that, in a slot in which the same case has just begun."""

    def step(self, state: np.ndarray, active: np.ndarray) -> None:
        """One step of all active slots.

        Args:
            state: vehicle states at its beginning [S, T].
            active: bool [S].
        """

    def robot(self, slot: int) -> RobotLimits | None:
        """When the robot that drives the ego of a slot lets go; None: the stack drives it."""

    def led_pose(self, slot: int) -> LedPose:
        """Where the robot of a slot has its ego now."""

    def intervene(self, slot: int, kind: int) -> None:
        """The stack of a slot has intervened, see :mod:`twin.scenario.driver`: its robot is gone
        until the next case begins."""

    def at(self, time_s: np.ndarray, varied: Any = None) -> Placement:
        """Where all bodies are now, whatever the times; see
        :class:`twin.actors.motion.Motion`."""

    def hulls(self) -> np.ndarray:
        """What vehicles may hit now [S, M, 8], as :meth:`at` has it:
        :meth:`twin.actors.motion.Placement.hulls`."""

    def act(self, slot: int, action: Any) -> int:
        """Carry out an intervention on a body between two steps, one of ``MoveObject``,
        ``SpawnObject``, ``RemoveObject`` and ``FreeObject`` of
        :mod:`schemas.wire.interventions`; the body it was done to.

        Raises:
            ValueError: it cannot be done; one line, and nothing has changed.
        """

    def moved(self, slot: int) -> frozenset[int]:
        """Bodies of a slot that an intervention has taken off the scenario."""

    def columns(self, slot: int) -> Mapping[str, float]:
        """KPI columns of a slot that it gives, now."""

    def ended(self, slot: int) -> bool:
        """Whether the case in a slot is over."""

    def fault(self, slot: int) -> str:
        """Why the case in a slot cannot be told to its end; empty: it can."""

    def environment(self, slot: int) -> ScriptedEnvironment | None:
        """What the scenario has said of weather, light and road so far; None: nothing."""

    def weathered(self) -> Sequence[int]:
        """Slots in which :meth:`environment` has changed since this was asked last."""

    def things(self, slot: int) -> Sequence[Thing]:
        """What the bodies of a slot are [M]."""

    def target(self, slot: int) -> CaseTarget | None:
        """What the trial of the case in a slot is about; None: it is no trial."""

    def events(self, slot: int) -> tuple[str, ...]:
        """Names of what may happen in the case of a slot."""


class CaseMotionMaker(Protocol):
    """A class of such motions."""

    def __call__(
        self,
        case: Case,
        vehicle: Vehicle,
        kinds: Sequence[Any],
        slots: int,
        device: Any,
        signals: Sequence[str],
    ) -> CaseMotion:
        """For the rig of a case.

        Args:
            case: any case of the rig.
            vehicle: the ego.
            kinds: looks of bodies of the world, :func:`twin.actors.palette.build_palette`.
            slots: S.
            device: of Warp.
            signals: traffic lights of the world, by their ids in its road file.

        Raises:
            ValueError: the rig cannot have it; one line.
        """
