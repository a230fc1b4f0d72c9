"""One environment: the vectorised one with a single slot."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import Env, error
from numpy.typing import NDArray

from twin.gym.vector_env import DriveVectorEnv


class DriveEnv(Env[dict[str, Any], Any]):
    """An environment that is reset by its user, as :class:`gymnasium.Env` has it."""

    def __init__(self, alone: DriveVectorEnv) -> None:
        """``alone``: with one environment, which is this."""
        self._alone = alone
        self.observation_space = alone.single_observation_space
        self.action_space = alone.single_action_space
        self.metadata = alone.metadata
        self.render_mode = alone.render_mode
        self._ended = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode: episode 0 of a seed, or the one after the last.

        Raises:
            UsageError: the seed or an option cannot be used; one line.
        """
        super().reset(seed=seed)
        seen, infos = self._alone.reset(seed=seed, options=options)
        self._ended = False
        return _first(seen), _info(infos)

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Drive for one step; ``action``: real [3], columns :data:`twin.gym.vector_env.ACTIONS`.

        Raises:
            gymnasium.error.ResetNeeded: nothing was reset yet, or the episode has ended.
            gymnasium.error.InvalidAction: wrong shape, NaN or out of range; one line.
        """
        if self._ended:
            raise error.ResetNeeded("the episode has ended; call reset() first")
        batch = action[None] if hasattr(action, "shape") and len(action.shape) else [action]
        seen, rewards, terminated, truncated, infos = self._alone.step(batch)
        self._ended = bool(terminated[0] or truncated[0])
        return (
            *(_first(seen), float(rewards[0]), bool(terminated[0]), bool(truncated[0])),
            _info(infos),
        )

    def render(self) -> NDArray[Any] | None:
        """What the main camera saw last, uint8 [H, W, 3], where ``render_mode`` is
        ``rgb_array``."""
        pictures = self._alone.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Give the engine back; again does nothing."""
        self._alone.close()

    def __reduce__(self) -> Any:
        return self._alone.__reduce__()


def _first(seen: dict[str, Any]) -> dict[str, Any]:
    return {name: array[0] for name, array in seen.items()}


def _info(infos: dict[str, Any]) -> dict[str, Any]:
    """The info of the one environment, of those of a vectorised one."""
    info: dict[str, Any] = {}
    for name, value in infos.items():
        if name.startswith("_"):
            continue
        if isinstance(value, dict):
            info[name] = _info(value)
        else:
            one = value[0]
            info[name] = one.item() if isinstance(one, np.generic) else one
    return info
