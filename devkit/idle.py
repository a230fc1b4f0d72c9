"""A stack that looks at nothing and stands still: what is left is the cost of the exchange."""

from __future__ import annotations

from devkit.stack import Observation, Stack
from schemas.messages import Command, Episode


class IdleStack(Stack):
    """A stack that only brakes."""

    portable = True
    reads = ()

    def reset(self, slot: int, episode: Episode) -> None:
        """There is nothing to forget."""

    def step(self, observation: Observation) -> list[Command]:
        """Full brakes for everybody."""
        return [
            Command(
                slot=slot,
                token=int(observation.token[slot]),
                tick=int(observation.tick[slot]),
                throttle=0.0,
                brake=1.0,
                steering_rad=0.0,
            )
            for slot in observation.active_slots()
        ]
