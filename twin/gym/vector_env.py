"""The vectorised environment: N cases of one rig in the slots of one engine."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import error, spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from schemas.case import Case
from schemas.messages import CameraSite, Command, Lights
from schemas.sections.repeated import SEED_MAX
from schemas.wire.control import Lease
from twin.base.errors import UsageError
from twin.gym.episode_cases import EpisodeCases
from twin.gym.observations import ArrayForm, Observations, chosen, shapes_of, space_of
from twin.gym.rewards import RewardFormula
from twin.rig.need_to_know import is_withheld
from twin.rig.running.rig_loop import RigLoop
from twin.rig.slot import Finished, Slot, Slots
from twin.world.kernel_cache import prepare_kernels

if TYPE_CHECKING:
    from twin.rig.engine import Engine

ENVS_MAX = 4096
"""Most environments of one engine."""

ACTIONS = ("steering_rad", "throttle", "brake")
"""What an action consists of."""
LAMPS = ("low", "high", "parking", "fog")
"""Lamps that may be on."""
ACTION_LOW, ACTION_HIGH = (-1.0, 0.0, 0.0), (1.0, 1.0, 1.0)


class DriveVectorEnv(VectorEnv[dict[str, Any], Any, NDArray[Any]]):
    """Environments 0 to N - 1, each a slot of the engine; ``docs/gym.md``.

    A step is the shortest time after which all sensors are due again, one or several control
    periods, in which the action is in force. An environment whose episode has ended begins the next
    one with the next step (``AutoresetMode.NEXT_STEP``), whose action it ignores.
    """

    single_observation_space: spaces.Dict

    def __init__(
        self,
        cases: EpisodeCases,
        num_envs: int,
        *,
        sensors: Sequence[str] | None,
        reward: str,
        device: str,
        array: ArrayForm,
        lights: Sequence[str],
        render_mode: str | None,
    ) -> None:
        """Arguments as of :func:`twin.gym.make_vec`.

        Raises:
            UsageError: something that was given cannot be used; one line.
        """
        _check_given(num_envs, array, render_mode)
        self._lights = _lights(lights)
        self._cases = cases
        self._reward = RewardFormula(reward, cases.kind)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._process = os.getpid()
        self._loop = RigLoop(_engine(cases, num_envs, device), Slots(num_envs))
        engine = self._loop.engine
        self._ticks = engine.refill_every
        self._tokens = 0
        there = self._first_look()
        withheld = [n for n in there if any(is_withheld(n, case) for case in cases.cases)]
        names = chosen(sensors, there, withheld)
        self._picture = _picture_of(engine, render_mode)
        pictures = [self._picture] if self._picture else []
        self._wanted = frozenset([*names, *pictures])
        self._observations = Observations(names, there, num_envs, device, array)
        self._pictures = Observations(pictures, there, num_envs, device, "numpy")
        self.single_observation_space = space_of(names, there)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.single_action_space = spaces.Box(
            np.array(ACTION_LOW, np.float32), np.array(ACTION_HIGH, np.float32), dtype=np.float32
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": 1e9 / (engine.control_period_ns * self._ticks),
            "autoreset_mode": AutoresetMode.NEXT_STEP,
        }
        self._seeds = [self._seed_of(cases.seed + env) for env in range(num_envs)]
        self._firsts: list[int | None] = [None] * num_envs
        self._episodes = [-1] * num_envs
        self._rows = [0] * num_envs
        """KPI rows of each episode that have been rewarded."""
        self._durations_ns = [0] * num_envs
        """Longest sim time of each episode [ns]."""
        self._over = np.zeros(num_envs, np.bool_)
        self._begun = False

    # --- Gymnasium's interface --------------------------------------------------------------

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode in every environment.

        Args:
            seed: environment ``i`` gets ``seed + i``, or the ``i``-th of a list, and begins with
                its episode 0; None: the episode after the last one, with the seed that it has.
            options: ``case``: name of the case of episode 0, or a list with one per environment.

        Raises:
            UsageError: a seed or an option cannot be used; one line.
        """
        self._check_usable()
        firsts = self._first_cases(options or {})
        if seed is not None:
            self._seeds = self._given_seeds(seed)
        super().reset(seed=int(seed) if isinstance(seed, (int, np.integer)) else None)
        if seed is not None or any(first is not None for first in firsts):
            self._firsts = firsts
            self._episodes = [-1] * self.num_envs
        self._begun = False  # until all have begun
        for slot in list(self._loop.slots):
            self._loop.withdraw(slot)
        infos: dict[str, Any] = {}
        for env in range(self.num_envs):
            infos = self._begin(env, infos)
        self._over[:] = False
        seen = self._look()
        self._begun = True
        return seen, infos

    def step(
        self, actions: Any
    ) -> tuple[
        dict[str, Any], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
    ]:
        """Drive for one step.

        Args:
            actions: real [N, 3], columns :data:`ACTIONS`.

        Returns:
            observations; rewards float64 [N]; terminated and truncated, bool [N]; infos.

        Raises:
            gymnasium.error.ResetNeeded: nothing was reset yet, or the last step did not end.
            gymnasium.error.InvalidAction: wrong shape, NaN or out of range; one line.
        """
        self._check_usable()
        if not self._begun:
            raise error.ResetNeeded("step before reset; call reset() first")
        driven = ~self._over
        given = self._checked(actions, driven)
        self._begun = False  # a step that was interrupted is half done
        rewards, finished = self._drive(given)
        infos: dict[str, Any] = {}
        terminated, truncated = (np.zeros(self.num_envs, np.bool_) for _ in range(2))
        for end in finished:
            rewards[end.slot] += self._reward.of_table(end.table, self._rows[end.slot])
            truncated[end.slot] = self._out_of_time(end)
            terminated[end.slot] = not truncated[end.slot]
            infos = self._add_info(infos, _told(end), end.slot)
        for env in np.flatnonzero(self._over).tolist():
            infos = self._begin(env, infos)
        self._over = terminated | truncated
        seen = self._look()
        self._begun = True
        return seen, rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """What the main camera of every environment saw last, uint8 [H, W, 3] each, where
        ``render_mode`` is ``rgb_array``."""
        self._check_usable()
        if not self._picture:
            return None
        return tuple(self._pictures.pictures(self._picture))

    @property
    def camera_sites(self) -> list[CameraSite]:
        """The cameras of the ego, as a stack is told of them, the main one first."""
        return list(self._loop.engine.camera_sites)

    def close_extras(self, **_: Any) -> None:
        """Give the engine back."""
        self._loop.engine.close()

    def __reduce__(self) -> Any:
        raise TypeError(
            "a driving environment holds a simulator and cannot be pickled or copied; make it in "
            "the process that steps it"
        )

    # --- a step -----------------------------------------------------------------------------

    def _drive(self, actions: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[Finished]]:
        """The control periods of a step; rewards of those who go on, and the cases that ended,
        whose rows since the last step are not rewarded yet."""
        ended: list[Finished] = []
        loop = self._loop
        before = [slot.index for slot in loop.slots.running]
        for period in range(self._ticks):
            if not loop.slots.running:
                break
            if period:  # a stack would look now, and answers what it has answered
                loop.sense(self._wanted)
            for finished in loop.step(self._commands(actions)):
                loop.leave(finished.slot)
                ended.append(finished)
        left = {finished.slot for finished in ended}
        stayed = [env for env in before if env not in left]
        rewards = np.zeros(self.num_envs)
        if stayed:
            values, valid = loop.engine.rows.tail(stayed, self._ticks, self._reward.columns)
            worth = self._reward.of_rows(values, valid, len(stayed) * self._ticks)
            rewards[stayed] = np.nansum(worth.reshape(len(stayed), self._ticks), axis=1)
        for env in stayed:
            self._rows[env] += self._ticks
        return rewards, ended

    def _commands(self, actions: NDArray[np.float64]) -> list[Command | None]:
        commands: list[Command | None] = [None] * self.num_envs
        ticks = self._loop.engine.tick.tolist()
        for slot in self._loop.slots.running:
            steering_rad, throttle, brake = actions[slot.index].tolist()
            commands[slot.index] = Command(
                slot=slot.index,
                token=slot.lease.token,
                tick=ticks[slot.index],
                throttle=throttle,
                brake=brake,
                steering_rad=steering_rad,
                lights=self._lights,
            )
        return commands

    def _begin(self, env: int, infos: dict[str, Any]) -> dict[str, Any]:
        """The next episode of an environment begins."""
        self._episodes[env] += 1
        self._rows[env] = 0
        episode = self._episodes[env]
        case = self._cases.of(self._seeds[env], episode, self._firsts[env])
        self._durations_ns[env] = round(case.variation.scenario.duration_s * 1e9)
        self._start(env, case)
        told = {"case": case.id, "seed": case.variation.seed, "episode": episode}
        return self._add_info(infos, told, env)

    def _start(self, env: int, case: Case) -> Slot:
        """A case begins in the slot of an environment."""
        self._tokens += 1
        try:
            return self._loop.begin(env, Lease(self._tokens, 1, "", case), _no_clock)
        except ValueError as mistake:
            raise UsageError(f"case {case.id}: {mistake}") from None

    def _look(self) -> dict[str, Any]:
        """Observations at the current ticks."""
        active = self._loop.engine.active.copy()
        if active.any():
            _, told = self._loop.sense(self._wanted)
            self._observations.update(told, active)
            self._pictures.update(told, active)
            self._loop.engine.wait()
        return self._observations.handed_out()

    def _out_of_time(self, end: Finished) -> bool:
        """Whether a case ended because its time was up, and not by what happened in it."""
        columns = end.table.columns
        up = columns["sim_time_ns"].values[-1] >= self._durations_ns[end.slot]
        return bool(up and columns["collisions"].values[-1] == 0 and end.outcome == "verdict")

    # --- what was given ---------------------------------------------------------------------

    def _checked(self, actions: Any, driven: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Actions as numbers; those of environments that are not driven may be anything."""
        if hasattr(actions, "cpu"):  # a tensor that may lie on a GPU
            actions = actions.detach().cpu()
        shape = (self.num_envs, len(ACTIONS))
        try:
            given = np.asarray(actions, np.float64)
        except (TypeError, ValueError):
            raise error.InvalidAction(
                f"actions: {type(actions).__name__} given, allowed: numbers of shape {shape}"
            ) from None
        if given.shape != shape:
            raise error.InvalidAction(
                f"actions: shape {given.shape} given, allowed: {shape}, {', '.join(ACTIONS)}"
            )
        fits = (given >= ACTION_LOW) & (given <= ACTION_HIGH) | ~driven[:, None]
        if not fits.all():
            env, column = np.argwhere(~fits)[0].tolist()
            raise error.InvalidAction(
                f"actions: {ACTIONS[column]} of environment {env} is {given[env, column]:g}, "
                f"allowed: {ACTION_LOW[column]:g} to {ACTION_HIGH[column]:g}"
            )
        return given

    def _given_seeds(self, seed: int | Sequence[int]) -> list[int]:
        if isinstance(seed, (int, np.integer)):
            return [self._seed_of(int(seed) + env) for env in range(self.num_envs)]
        if not isinstance(seed, (list, tuple, np.ndarray)):
            raise UsageError(f"seed: {seed!r} given, allowed: a number, or {self.num_envs}")
        if len(seed) != self.num_envs:
            raise UsageError(f"seed: {len(seed)} given, allowed: one, or {self.num_envs}")
        return [self._seed_of(each) for each in seed]

    def _seed_of(self, seed: int) -> int:
        if not isinstance(seed, (int, np.integer)) or not 0 <= seed <= SEED_MAX:
            raise UsageError(f"seed: {seed} given, allowed: 0 to {SEED_MAX}")
        return int(seed)

    def _first_cases(self, options: Mapping[str, Any]) -> list[int | None]:
        if unknown := sorted(options.keys() - {"case"}):
            raise UsageError(f"options: no '{unknown[0]}'; allowed: case")
        case = options.get("case")
        if case is None:
            return [None] * self.num_envs
        is_list = isinstance(case, (list, tuple, np.ndarray))
        names = list(case) if is_list else [case] * self.num_envs
        if not all(isinstance(name, str) for name in names):
            raise UsageError(f"options: case {case!r} given, allowed: a name, or a list of names")
        if len(names) != self.num_envs:
            raise UsageError(f"options: {len(names)} cases given, allowed: one, or {self.num_envs}")
        return [self._cases.number(name) for name in names]

    def _check_usable(self) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError("the environment is closed; make another")
        if os.getpid() != self._process:
            raise UsageError(
                f"the environment was made in process {self._process}, this is {os.getpid()}: a "
                "simulator does not outlive a fork; make it in the process that steps it"
            )

    def _first_look(self) -> dict[str, Any]:
        """Shapes of all readings, as the first case gives them."""
        slot = self._start(0, self._cases.cases[0])
        _, told = self._loop.sense(None)
        shapes = shapes_of(told)
        self._loop.withdraw(slot)
        return shapes


def _no_clock() -> float:
    """Nobody asks how long an episode takes by the wall clock."""
    return 0.0


def _told(end: Finished) -> dict[str, Any]:
    """What the info of an episode's last step says; missing KPIs are NaN."""
    kpis = {name: np.nan if v is None else float(v) for name, v in end.scalars.items()}
    told: dict[str, Any] = {"outcome": end.outcome, "verdict": end.verdict}
    told |= {"passed": end.passed, "reasons": "; ".join(end.reasons), "kpis": kpis}
    return told | ({"kpi_names": dict(end.names)} if end.names else {})


def _lights(names: Sequence[str]) -> Lights:
    """Lamps of these names are on."""
    for name in names:
        if name not in LAMPS:
            raise UsageError(f"lights: {name!r} given, allowed: a list of {', '.join(LAMPS)}")
    return Lights(**dict.fromkeys(names, True))


def _engine(cases: EpisodeCases, slots: int, device: str) -> Engine:
    prepare_kernels()  # before the modules that define kernels
    from twin.rig.engine import Engine

    try:
        return Engine(cases.cases[0], slots, device)
    except ValueError as mistake:
        raise UsageError(str(mistake)) from None


def _picture_of(engine: Engine, render_mode: str | None) -> str:
    """Message of the main camera; empty: nothing is rendered for people."""
    if render_mode is None:
        return ""
    if not engine.camera_sites:
        raise UsageError("render_mode: the campaign has no camera that sees; allowed: None")
    return str(engine.camera_sites[0].message)


def _check_given(num_envs: int, array: ArrayForm, render_mode: str | None) -> None:
    if isinstance(num_envs, bool) or not isinstance(num_envs, int):
        raise UsageError(f"num_envs: {num_envs!r} given, allowed: 1 to {ENVS_MAX}")
    if not 1 <= num_envs <= ENVS_MAX:
        raise UsageError(f"num_envs: {num_envs} given, allowed: 1 to {ENVS_MAX}")
    if not callable(array) and array not in ("numpy", "dlpack"):
        raise UsageError(
            f"array: {array!r} given, allowed: numpy, dlpack or a function of a DLPack array"
        )
    if render_mode not in (None, "rgb_array"):
        raise UsageError(f"render_mode: {render_mode!r} given, allowed: None, rgb_array")
