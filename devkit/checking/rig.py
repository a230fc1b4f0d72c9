"""A rig for ``devkit check``: made-up drives, and faults on the way."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

from devkit.checking.frames import CheckDrive, episode_of, sense
from devkit.checking.stack_rig import StackRig
from schemas import SCHEMA_VERSION
from schemas.case import Case
from schemas.messages import Command, Commands, Episode, Frame, Tick
from schemas.wire import topics
from schemas.wire.codec import WireError, decode
from twin.fabric.bus import Bus, Sample
from twin.fabric.drive import Outgoing

ANSWERS_MAX = 100
"""Answers that are kept, to be compared with repeated ones."""


def _warm(_tick: int) -> bool:
    """No fault, every time counts."""
    return False


class Faulty:
    """The bus, with messages of one tick lost, changed or sent twice."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.lose = ""
        """Name of a sensor whose next message is lost."""
        self.change_tick = False
        """The next tick has keys of a later minor version."""
        self.lost = 0
        self.changed = 0

    def publish(
        self, key: str, payload: bytes, attachment: bytes = b"", *, block: bool = False
    ) -> None:
        """Publish, unless a fault is due."""
        if self.lose and key.endswith(f"/sensor/{self.lose}"):
            self.lose = ""
            self.lost += 1
            return
        if self.change_tick and key.endswith("/tick"):
            self.change_tick = False
            self.changed += 1
            plain = msgpack.unpackb(payload)
            payload = msgpack.packb({**plain, "moon_phase": [0.5], "later": {"minor": 99}})
        self._bus.publish(key, payload, attachment, block=block)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)


class CheckRig(StackRig):
    """One stack process with S slots; drives made-up cases with it."""

    def __init__(
        self, case: Case, slots: int, bus: Bus, rig: str, child: subprocess.Popen[bytes], log: Any
    ) -> None:
        self.bus = Faulty(bus)
        super().__init__(case, slots, self.bus, rig, child, log)  # type: ignore[arg-type]
        self._answers: deque[bytes] = deque(maxlen=ANSWERS_MAX)
        bus.subscribe(topics.COMMAND.key.format(rig=rig), self._keep)
        self.tokens: list[int] = []
        """Tokens of the last drives, by slot."""
        self._last: tuple[Tick, list[Outgoing]] | None = None
        self.wall_s: list[float] = []
        """Wall time of every exchange without a fault [s]."""

    def _keep(self, sample: Sample) -> None:
        self._answers.append(sample.payload)

    def drive(
        self,
        drives: list[CheckDrive | None],
        ticks: int,
        timeout_s: float,
        before: Callable[[int], bool] = _warm,
    ) -> list[list[Command]]:
        """New cases in all slots, ``ticks`` long.

        Args:
            drives: one per slot, None: stays empty.
            ticks: how many.
            timeout_s: longest wait for an answer [s].
            before: runs before each tick; true: a fault was set up, so its time does not count.

        Returns:
            The commands of every tick, by slot.
        """
        tokens = self.tokens = [self._token + 1 + slot for slot in range(len(drives))]
        self._token += len(drives)
        return [self._exchange(drives, tokens, t, timeout_s, before(t)) for t in range(ticks)]

    def repeat(self, timeout_s: float) -> tuple[bytes, bytes]:
        """Publish the last seq once more; the answer before, and the one to the repeat."""
        assert self._last is not None
        what = "does not answer a repeated seq"
        wait = self._patience(timeout_s, what)
        tick, sensors = self._last
        self.exchange(tick, sensors, [], timeout_s, what)
        while len(answers := self._answers_to(tick.seq)) < 2:
            wait()
            time.sleep(0.001)  # they are on their way to us twice, on two subscriptions
        return answers[0], answers[1]

    def _answers_to(self, seq: int) -> list[bytes]:
        answers = []
        for data in tuple(self._answers):
            with contextlib.suppress(WireError):  # the exchange says what is wrong with it
                if decode(data, Commands).seq == seq:
                    answers.append(data)
        return answers

    def _exchange(
        self,
        drives: list[CheckDrive | None],
        tokens: list[int],
        tick: int,
        timeout_s: float,
        faulty: bool,
    ) -> list[Command]:
        episodes = [
            episode_of(self._case, drive, slot, tokens[slot], self._seq)
            for slot, drive in enumerate(drives)
            if drive is not None and tick == 0
        ]
        message, sensors = self._messages(drives, tokens, tick, episodes)
        started_s = time.monotonic()
        what = f"does not answer tick {tick}"
        answer = self.exchange(message, sensors, episodes, timeout_s, what)
        if not faulty:
            self.wall_s.append(time.monotonic() - started_s)
        self._last = message, sensors
        self._seq += 1
        return sorted(answer.commands, key=lambda command: command.slot)

    def _messages(
        self, drives: list[CheckDrive | None], tokens: list[int], tick: int, episodes: list[Episode]
    ) -> tuple[Tick, list[Outgoing]]:
        period_ns = 1_000_000_000 // self._case.rig.control_hz
        active = [drive is not None for drive in drives]
        stamp: dict[str, Any] = {
            "v": SCHEMA_VERSION,
            "seq": self._seq,
            "active": active,
            "token": [token if on else 0 for token, on in zip(tokens, active, strict=True)],
            "tick": [tick if on else 0 for on in active],
            "sim_time_ns": [tick * period_ns if on else 0 for on in active],
        }
        outgoing = []
        for name, (values, count) in sense(self._case, drives, tick).items():
            array = np.ascontiguousarray(values)
            frame = Frame(
                **stamp,
                type=name,
                case=[drive.case if drive else "" for drive in drives],
                dtype=array.dtype.newbyteorder("<").str,
                shape=list(array.shape),
                encoding=topics.sensor_topic(name).type,
                count=count or [],
            )
            outgoing.append(Outgoing(name, frame, array.tobytes()))
        names = [sensor.name for sensor in outgoing]
        return Tick(**stamp, sensors=names, episodes=len(episodes)), outgoing
