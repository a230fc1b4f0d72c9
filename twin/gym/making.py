"""How environments are made, and those that are shipped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from twin.base.errors import UsageError

try:
    import gymnasium
except ModuleNotFoundError:  # the extra is not installed
    raise UsageError("twin.gym needs Gymnasium: pip install 'drivetwin[gym]'") from None

from twin.gym.episode_cases import read_cases
from twin.gym.observations import ArrayForm
from twin.gym.single_env import DriveEnv
from twin.gym.vector_env import DriveVectorEnv

REWARD = "0.1 * speed_mps - 10 * collisions"
"""Reward where none is given: get on, and touch nothing."""

SHIPPED = {
    "lane-loop": "0.02 * speed_mps - abs(lateral_error_m) - 10 * collisions",
    "aeb-demo": REWARD,
    "aeb-256": REWARD,
}
"""Campaigns that are registered as ``drivetwin/NAME-v0``, with their rewards."""


def make_vec(
    campaign: str | Path = "lane-loop",
    num_envs: int = 1,
    *,
    sensors: Sequence[str] | None = None,
    reward: str = REWARD,
    device: str = "cpu",
    array: ArrayForm = "numpy",
    lights: Sequence[str] = (),
    settings: Mapping[str, Any] | None = None,
    cases: Sequence[str] | None = None,
    render_mode: str | None = None,
) -> DriveVectorEnv:
    """Make a vectorised environment of the cases of a campaign.

    Args:
        campaign: shipped name, or path of a campaign file.
        num_envs: number of environments N, 1 to :data:`twin.gym.vector_env.ENVS_MAX`.
        sensors: sensor messages that they see; None: all that the campaign gives.
        reward: formula over KPI columns, summed over the rows that a step writes.
        device: ``cpu`` or ``cuda:N``.
        array: form of observations, see :data:`twin.gym.observations.ArrayForm`.
        lights: lamps of the egos that are on, names of :data:`twin.gym.vector_env.LAMPS`.
        settings: keys at the top of the campaign file that are replaced, each whole.
        cases: names of the cases to run; None: all.
        render_mode: ``rgb_array``: :meth:`DriveVectorEnv.render` gives pictures.

    Raises:
        UsageError: something that was given cannot be used; one line.
    """
    return DriveVectorEnv(
        read_cases(campaign, settings, cases),
        num_envs,
        sensors=sensors,
        reward=reward,
        device=device,
        array=array,
        lights=lights,
        render_mode=render_mode,
    )


def make(campaign: str | Path = "lane-loop", **options: Any) -> DriveEnv:
    """Make a single environment; ``options`` as of :func:`make_vec`, without ``num_envs``.

    Raises:
        UsageError: something that was given cannot be used; one line.
    """
    return DriveEnv(make_vec(campaign, 1, **options))


def register_shipped() -> None:
    """Make the shipped environments known to Gymnasium; again does nothing."""
    for name, reward in SHIPPED.items():
        if (known := f"drivetwin/{name}-v0") not in gymnasium.registry:
            gymnasium.register(
                known,
                entry_point="twin.gym.making:make",
                vector_entry_point="twin.gym.making:make_vec",
                kwargs={"campaign": name, "reward": reward},
            )
