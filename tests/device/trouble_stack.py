"""A stack that drives as the shipped one, and comes to grief in cases that its parameters name."""

from __future__ import annotations

import os
import signal
import time

import msgspec
import warp as wp

from devkit.aeb import AebStack
from devkit.stack import Observation
from schemas.messages import Command, Episode

TICK = 3
"""When it happens."""


class TroubledStack(AebStack):
    """``nan``, ``crash``, ``hang``, ``memory`` and ``fault`` name one case each, or none."""

    takes_device_frames = True

    def __init__(
        self,
        slots: int,
        *,
        nan: str = "",
        crash: str = "",
        hang: str = "",
        memory: str = "",
        fault: str = "",
    ) -> None:
        super().__init__(slots)
        self._troubles = {nan: "nan", crash: "crash", hang: "hang", memory: "memory"}
        self._troubles[fault] = "fault"
        self._of_slot = [""] * slots
        self._device = "cpu"

    def reset(self, slot: int, episode: Episode) -> None:
        super().reset(slot, episode)
        self._of_slot[slot] = self._troubles.get(episode.case, "")
        self._device = episode.device

    def step(self, observation: Observation) -> list[Command]:
        commands = super().step(observation)
        for index, command in enumerate(commands):
            trouble = self._of_slot[command.slot]
            if trouble and observation.tick[command.slot] == TICK:
                print(f"now comes {trouble}", flush=True)
                commands[index] = self._comes(trouble, command)
        return commands

    def _comes(self, trouble: str, command: Command) -> Command:
        if trouble == "nan":
            return msgspec.structs.replace(command, throttle=float("nan"))
        if trouble == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if trouble == "hang":
            time.sleep(1e6)
        if trouble == "memory":
            _take_all(self._device)
        if trouble == "fault":
            _write_nowhere(self._device)
        raise AssertionError(f"{trouble} did not come")


def _take_all(device: str) -> None:
    """Memory of the GPU, until there is none."""
    if device == "cpu":
        raise MemoryError("out of memory")
    taken = []
    while True:
        taken.append(wp.zeros(1 << 30, dtype=wp.float32, device=device))


@wp.kernel
def _write_kernel(there: wp.array(dtype=wp.uint8)):
    there[wp.tid()] = wp.uint8(1)


def _write_nowhere(device: str) -> None:
    """An address that is not ours: the driver ends everything this process does on its GPU."""
    if device == "cpu":
        os.kill(os.getpid(), signal.SIGBUS)
    there = wp.array(ptr=1 << 20, shape=(64,), dtype=wp.uint8, device=device, copy=False)
    wp.launch(_write_kernel, 64, outputs=[there], device=device)
    there.numpy()  # the driver says it to whoever asks next
    raise RuntimeError("wrote where it must not")
