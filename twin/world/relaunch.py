"""Launches that are made again and again with the same arguments, as a rig's are at every tick."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import warp as wp

COMMANDS_MAX = 64
"""Most launches that are remembered; beyond it all are forgotten."""


class Relaunch:
    """Launches kernels on one device.

    The arguments of a launch are packed once: to check and pack them takes Warp 60 us, as long as
    some of the kernels. Arguments are the same if they are the same objects, or equal
    numbers; what a struct or an array holds may change.
    """

    def __init__(self, device: wp.Device) -> None:
        self._device = device
        self._commands: dict[tuple[Any, ...], wp.Launch | None] = {}

    def __call__(
        self,
        kernel: wp.Kernel,
        dim: int | tuple[int, ...],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        block_dim: int | None = None,
        stream: wp.Stream | None = None,
    ) -> None:
        """Launch as :func:`wp.launch` does; ``stream``: of a GPU, by default the device's own."""
        launch = partial(
            wp.launch,
            kernel,
            dim,
            inputs=inputs,
            outputs=outputs,
            device=self._device,
            block_dim=block_dim,
        )
        # A command keeps its arguments, so nothing else gets their identities.
        given = (
            one if type(one) is int else one.hex() if type(one) is float else id(one)
            for one in inputs
        )
        key = (kernel, dim, block_dim, *given, *map(id, outputs))
        if key not in self._commands:
            if len(self._commands) >= COMMANDS_MAX:
                self._commands.clear()
            self._commands[key] = launch(record_cmd=True)
        command = self._commands[key]
        if command is not None:  # there is something to launch
            command.launch(stream)


class SideStream:
    """A second stream of a GPU, for launches that have nothing to do with those beside them: one
    fills the multiprocessors that the last threads of the other leave idle."""

    def __init__(self, device: wp.Device) -> None:
        self._device = device
        self.stream = wp.Stream(device)
        self._forked, self._done = wp.Event(device), wp.Event(device)

    def fork(self) -> None:
        """What is launched on it from now on begins after what is on the device's own stream."""
        self._device.stream.record_event(self._forked)
        self.stream.wait_event(self._forked)

    def join(self) -> None:
        """What is launched on the device's own stream from now on begins after what is on it."""
        self.stream.record_event(self._done)
        self._device.stream.wait_event(self._done)
