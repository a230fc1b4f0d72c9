"""Time of a step of storyboard programs: 16 reacting actors in each slot, at 100 Hz.

On a CPU the figure is also set against the simulator's loop of a shipped campaign, run for it. What
moving bodies cost the cameras is measured in the same run (:mod:`twin.bench.moving_bodies`).
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import warp as wp

from twin.base.progress import steps
from twin.bench import moving_bodies
from twin.bench.campaign import Request
from twin.bench.campaign import measure as measure_campaign
from twin.bench.storyboard_traffic import reacting_traffic, ring_network
from twin.road.tables.road_tables import road_tables
from twin.scenario.storyboard.player.storyboard_player import StoryboardPlayer

ACTORS = 16
SLOTS = {"cpu": 1, "cuda": 256}
TARGET_MS = 0.3
"""Of a step of all slots on a GPU [ms]."""
TARGET_SHARE = 0.1
"""Of the loop of a shipped campaign on a CPU."""
DEMO = "aeb-demo"
_STEP_S = 0.01
_WARM = 200
_STEPS = 500
_ROUNDS = 5


@dataclass(frozen=True, slots=True)
class StoryboardFigures:
    """Figures of the storyboard bench."""

    device: str
    slots: int
    actors: int
    step_ms: float
    """A step of all slots; the best of the rounds [ms]."""
    demo_ms_per_sim_s: float | None
    """The loop of the shipped campaign per simulated second; None: not measured [ms]."""
    cameras: moving_bodies.MovingBodies | None = None
    """None: not measured."""

    @property
    def share(self) -> float | None:
        """Time of storyboards per simulated second, of that of the shipped campaign."""
        if self.demo_ms_per_sim_s is None:
            return None
        return self.step_ms / _STEP_S / self.slots / self.demo_ms_per_sim_s

    @property
    def missed(self) -> list[str]:
        """Targets that were missed."""
        missed = [] if self.cameras is None else self.cameras.missed
        if self.device.startswith("cuda") and self.step_ms > TARGET_MS:
            return [f"{self.step_ms:.3f} of {TARGET_MS:g} ms a step", *missed]
        if self.share is not None and self.share > TARGET_SHARE:
            return [f"{self.share:.1%} of {TARGET_SHARE:.0%} of a demo case's time", *missed]
        return missed


def measure(
    device: str, slots: int = 0, actors: int = ACTORS, *, demo: bool = True, cameras: bool = True
) -> StoryboardFigures:
    """Step ``slots`` slots of ``actors`` actors that run four different programs.

    Args:
        device: cpu or cuda:N.
        slots: default: 1 on a CPU, 256 on a GPU.
        actors: of each slot.
        demo: on a CPU, run the shipped campaign as well.
        cameras: measure as well what moving bodies cost the cameras.
    """
    slots = slots or SLOTS[device.partition(":")[0]]
    programs = [reacting_traffic(actors, variant) for variant in range(4)]
    player = StoryboardPlayer(programs, road_tables(ring_network()), slots, device=device)
    for slot in range(slots):
        player.start(slot, slot % len(programs))
    best = float("inf")
    for round_number in steps("rounds", range(_ROUNDS + 1)):
        wp.synchronize_device(player.device)
        begin = time.perf_counter()
        count = _STEPS if round_number else _WARM
        for _ in range(count):
            player.step()
        wp.synchronize_device(player.device)
        if round_number:
            best = min(best, (time.perf_counter() - begin) / count)
    loop = None
    if demo and not device.startswith("cuda"):
        with tempfile.TemporaryDirectory() as folder:
            row = measure_campaign(Request(DEMO, device, Path(folder), cases=1), 1)
        loop = row.loop_ms_per_sim_s
    seen = moving_bodies.measure(device) if cameras else None
    return StoryboardFigures(device, slots, actors, 1e3 * best, loop, seen)


def as_json(figures: StoryboardFigures) -> dict[str, Any]:
    """The figures with their targets."""
    targets = {"target_ms": TARGET_MS, "target_share": TARGET_SHARE}
    cameras = figures.cameras
    slower = None if cameras is None else cameras.slower
    return {
        **asdict(figures),
        "share": figures.share,
        "slower": slower,
        "target_slower": moving_bodies.TARGET_SLOWER,
        **targets,
    }


def lines(figures: StoryboardFigures) -> list[str]:
    """The figures in words."""
    rate = figures.slots * figures.actors / figures.step_ms
    said = [
        f"{figures.step_ms:.3f} ms a step of {_STEP_S * 1e3:g} ms on {figures.device}: "
        f"{figures.slots} slots x {figures.actors} actors, {rate:,.0f} actors a millisecond"
        + (f" (target {TARGET_MS:g} ms)" if figures.device.startswith("cuda") else "")
    ]
    if figures.share is not None:
        said.append(
            f"{figures.share:.1%} of the {figures.demo_ms_per_sim_s:.0f} ms that the loop of "
            f"{DEMO} takes per simulated second (target {TARGET_SHARE:.0%})"
        )
    if figures.cameras is not None:
        said += moving_bodies.lines(figures.cameras)
    return said
