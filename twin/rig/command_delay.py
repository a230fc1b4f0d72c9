"""Delays of commands: declared latency, its jitter, a slower stack, losses. In sim time.

Draws are whole numbers from (case's stream, case tick): nothing depends on slots, order or load.
"""

from __future__ import annotations

import hashlib
import struct
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from schemas.case import Case
from schemas.identity import case_stream
from schemas.messages import Command, Lights
from twin.vehicle.fleet import Fleet
from twin.vehicle.model import PHYSICS_STEP_NS

_ONE = 1 << 64


class Delays:
    """The way of one case's commands."""

    def __init__(self, case: Case) -> None:
        self._latency_ns = case.variation.latency_ms * 1_000_000
        self._jitter_ns = case.variation.latency_jitter_ms * 1_000_000
        self._every = case.rig.control_hz // case.variation.rate_hz if case.variation.rate_hz else 1
        self._drop = int(case.variation.drop * _ONE)
        self.redraw(lambda stream: case_stream(case, stream))

    def redraw(self, key: Callable[[str], int]) -> None:
        """Draw by other keys, by the names of the streams, from the next command on."""
        self._keys = {name: key(name) for name in ("latency", "drop")}

    def send(
        self, pending: deque[tuple[int, Command]], first_step: int, tick: int, command: Command
    ) -> None:
        """Put ``command`` on its way, unless it gets lost.

        One that arrives before older ones makes them void: nobody obeys an old command after a
        newer one.

        Args:
            pending: commands on their way with the physics steps of their arrival, ascending.
            first_step: physics step at which it was given.
            tick: case tick.
            command: what was asked for.
        """
        if tick % self._every:
            return
        if self._drop and self._draw("drop", tick) < self._drop:
            return
        delay_ns = self._latency_ns
        if self._jitter_ns:
            delay_ns += self._draw("latency", tick) * (self._jitter_ns + 1) // _ONE
        arrival = first_step - (-delay_ns // PHYSICS_STEP_NS)
        while pending and pending[-1][0] >= arrival:
            pending.pop()
        pending.append((arrival, command))

    def _draw(self, stream: str, tick: int) -> int:
        """Evenly in 0 to 2^64 - 1."""
        counter = struct.pack("<QQ", self._keys[stream], tick)
        return int.from_bytes(hashlib.sha256(counter).digest()[:8], "little")


class CommandedRun(Protocol):
    """A case that commands are for."""

    pending: deque[tuple[int, Command]]
    """Commands with the physics step from which they are in force."""
    delays: Delays
    lights: Lights
    """Lamps in force."""


def put_in_force(
    vehicles: Fleet,
    commands: Sequence[tuple[int, CommandedRun, Command]],
    tick: np.ndarray,
    sim_time_ns: np.ndarray,
    steps: int,
) -> None:
    """Work out which commands are in force in the coming period, and from which step.

    Of several that arrive within one period the newest counts.

    Args:
        vehicles: told of it.
        commands: slots, their cases, and what each is commanded now.
        tick: of all slots [S].
        sim_time_ns: of all slots [S].
        steps: physics steps of the period.
    """
    first_steps = sim_time_ns // PHYSICS_STEP_NS
    which = np.array([slot for slot, _, _ in commands], np.int64)
    vehicles.first_step[which] = first_steps[which]
    vehicles.commands[which, 0, 0] = vehicles.commands[which, 0, 1]
    vehicles.switch_step[which] = steps
    slots, asked, switches = [], [], []
    for (slot, run, command), first_step in zip(commands, first_steps[which].tolist(), strict=True):
        run.delays.send(run.pending, first_step, int(tick[slot]), command)
        while run.pending and run.pending[0][0] < first_step + steps:
            step, current = run.pending.popleft()
            slots.append(slot)
            pedals = (current.throttle, current.brake, current.steering_rad, current.handbrake)
            asked.append((*pedals, -1.0 if current.reverse else 1.0))
            switches.append(step - first_step)
            run.lights = current.lights
    if slots:
        vehicles.commands[slots, 0, 1] = asked
        vehicles.switch_step[slots] = switches
