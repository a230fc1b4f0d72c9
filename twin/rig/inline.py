"""The stack in the simulator's own process (``autonomy.placement: inline``).

The same arrays go to the same stack as through the drive plane, and the same commands come back;
what is saved is the message, the other process and its wake-up. A stack that dies takes its
simulator with it, which the worker treats alike.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from schemas.case import Case
from schemas.messages import Commands, Episode, Tick
from twin.fabric.drive import Incoming, check_answer
from twin.sensors.data import SensorData
from twin.sensors.wanted import Wanted

HOST = "devkit.hosting.host:Inline"
"""What runs a stack in this process, by name: the simulator does not import `devkit`."""


class InlineStack:
    """Answers ticks as :meth:`twin.fabric.drive.SimulatorEnd.exchange` does."""

    def __init__(self, case: Case, slots: int) -> None:
        """Load the stack of ``case``.

        Raises:
            StackFaultError: it cannot be loaded, which is its own doing; one line.
            InfrastructureError: there is no such stack here.
            RefusedError: it is not the one that was submitted; one line.
        """
        module, _, name = HOST.partition(":")
        host = getattr(importlib.import_module(module), name)
        self._host: Any = host(case.rig.stack, slots, case.rig.parameters, case.rig.source)

    @property
    def reads(self) -> Wanted:
        """Sensor messages that it looks at."""
        wanted: Wanted = self._host.reads
        return wanted

    def exchange(
        self, tick: Tick, sensed: dict[str, SensorData], episodes: list[Episode]
    ) -> Commands:
        """The commands for one seq.

        Raises:
            StackFaultError: the stack cannot go on.
            InfrastructureError: it cannot, because of the machine.
        """
        device_frames = self._host.takes_device_frames
        incoming = Incoming(
            tick,
            episodes,
            {
                name: InlineFrame(data)
                if device_frames and data.device is not None
                else _shown(data.values)
                for name, data in sensed.items()
            },
            {name: data.count for name, data in sensed.items() if data.count is not None},
        )
        answer: Commands = self._host.answer(incoming)
        check_answer(answer)
        return answer

    def close(self) -> None:
        """The rig has come to its end."""
        self._host.close()


def _shown(values: np.ndarray) -> np.ndarray:
    """Read-only, as through the drive plane: recordings show the same arrays."""
    shown = np.ascontiguousarray(values).view()
    shown.flags.writeable = False
    return shown


class InlineFrame:
    """An array in the GPU's memory, as :class:`~twin.base.gpu.cuda.DeviceFrame`."""

    def __init__(self, data: SensorData) -> None:
        self._data = data
        assert data.device is not None
        interface: dict[str, Any] = data.device.__cuda_array_interface__
        self.__cuda_array_interface__ = interface
        self.shape = tuple(interface["shape"])
        self.dtype = np.dtype(interface["typestr"])

    def host(self) -> np.ndarray:
        """The values in the host's memory."""
        return _shown(self._data.values)
