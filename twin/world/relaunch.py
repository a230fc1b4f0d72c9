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
    ) -> None:
        """Launch as :func:`wp.launch` does."""
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
            command.launch()
