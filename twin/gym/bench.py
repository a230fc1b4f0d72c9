"""Learning environments, and a campaign of the same cases with a stack that does nothing.

Both simulate cases of one scenario with the same sensors and commands on one machine: the campaign
with conductor, worker, simulator and stack, the environments in this process.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schemas.files.yaml_file import dump_yaml
from schemas.words import counted
from twin.bench.campaign import Request
from twin.bench.campaign import measure as run_campaign
from twin.gym import make_vec

TARGET_SHARE = 0.8
"""Least share of the campaign's camera frames per second."""
DURATION_S = 10.0
"""Sim time of an episode, if nothing ends it [s]."""
ROUNDS = 2
"""Episodes of every environment, and cases of every slot."""


@dataclass(frozen=True, slots=True)
class GymFigures:
    """What was measured."""

    campaign: str
    device: str
    envs: int
    sensors: list[str]
    """Sensor messages that both have."""
    steps: int
    steps_per_s: float
    """Steps of all environments together per second of wall time; those at which an episode begins
    count."""
    frames_per_s: float
    """Pictures of all cameras together that environments saw per second of wall time."""
    campaign_frames_per_s: float
    """The same of the campaign, from its first tick to its last."""

    @property
    def share(self) -> float:
        """Frames of the environments per frame of the campaign."""
        return self.frames_per_s / self.campaign_frames_per_s

    @property
    def missed(self) -> list[str]:
        """Targets that were missed; a CPU has none."""
        if self.share >= TARGET_SHARE or not self.device.startswith("cuda"):
            return []
        return [f"{100 * self.share:.0f} of {100 * TARGET_SHARE:g} % of the campaign's frames/s"]


def measure(
    campaign: str,
    envs: int,
    device: str,
    folder: Path,
    report: Callable[[int, int], object] = lambda *_: None,
) -> GymFigures:
    """Run the campaign, then the environments.

    Args:
        campaign: shipped name, or path of a file.
        envs: number of environments, and of slots.
        device: ``cpu`` or ``cuda:N``.
        folder: for the campaign.
        report: told how many cases of the campaign have ended, of how many.

    Raises:
        UsageError: the campaign cannot be used.
        InfrastructureError: it did not end.
    """
    path = folder / "bench-gym.yaml"
    path.write_text(dump_yaml(_content(campaign, envs)), encoding="utf-8")
    request = Request(str(path), device, folder / "runs", options=("--view", "none"))
    row = run_campaign(request, envs, report)
    campaign_frames_per_s = row.frames / row.loop_s
    with contextlib.closing(make_vec(path, envs, device=device, array="dlpack")) as learner:
        names = list(learner.single_observation_space.spaces)
        cameras = sum(name.partition(".")[0] == "camera" for name in names)
        idle = np.tile([0.0, 0.0, 1.0], (envs, 1))  # as the stack does
        learner.reset()
        learner.step(idle)  # whatever is done once is done
        learner.reset()
        steps = frames = 0
        left = np.full(envs, ROUNDS)
        begun_s = time.perf_counter()
        while (left > 0).any():
            _, _, terminated, truncated, _ = learner.step(idle)
            steps += envs
            frames += cameras * int(envs - (terminated | truncated).sum())
            left -= terminated | truncated
        wall_s = time.perf_counter() - begun_s
    return GymFigures(
        campaign,
        device,
        envs,
        names,
        steps,
        steps / wall_s,
        frames / wall_s,
        campaign_frames_per_s,
    )


def _content(campaign: str, envs: int) -> dict[str, Any]:
    """A campaign of as many cases as slots and environments take in :data:`ROUNDS` episodes."""
    return {
        "extends": str(Path(campaign).absolute()) if Path(campaign).is_file() else campaign,
        "campaign": "bench-gym",
        "autonomy": {"stack": "devkit.idle:IdleStack"},
        "matrix": {"repeat": list(range(ROUNDS * envs)), "scenario.duration_s": [DURATION_S]},
    }


def as_json(figures: GymFigures) -> dict[str, Any]:
    """All of it as plain values."""
    return {**asdict(figures), "share": figures.share, "target_share": TARGET_SHARE}


def lines(figures: GymFigures) -> list[str]:
    """The figures for people."""
    return [
        f"{counted(figures.envs, 'environment')} of {figures.campaign} on {figures.device}, "
        f"sensors {', '.join(figures.sensors)}",
        f"{figures.steps_per_s:,.0f} steps/s, {figures.frames_per_s:,.0f} camera frames/s",
        f"the campaign with a stack that does nothing: {figures.campaign_frames_per_s:,.0f} camera "
        f"frames/s; the environments reach {100 * figures.share:.0f} % "
        f"(target {100 * TARGET_SHARE:g} %)",
    ]
