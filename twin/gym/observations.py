"""What environments see: an array per sensor message, kept until a sensor looks again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp
from gymnasium import spaces
from numpy.typing import NDArray

from schemas.validation import suggest
from twin.base.errors import UsageError
from twin.sensors.data import SensorData

COUNT = ".count"
"""Behind the name of a message: how many of its rows are valid."""

ArrayForm = Literal["numpy", "dlpack"] | Callable[[Any], Any]
"""``numpy``: arrays of the host. ``dlpack``: arrays that speak DLPack and lie where the simulator
computes. A function, such as ``torch.from_dlpack``: what it makes of these."""


@dataclass(frozen=True, slots=True)
class ReadingShape:
    """What a sensor message gives for one environment."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    ragged: bool
    """Rows beyond a number that comes with it are zeros."""


def shapes_of(told: Mapping[str, SensorData]) -> dict[str, ReadingShape]:
    """Shapes of the readings of a tick at which all sensors are due."""
    return {
        name: ReadingShape(data.shape[1:], _dtype(data), data.count is not None)
        for name, data in told.items()
    }


def chosen(
    sensors: Sequence[str] | None, there: Mapping[str, ReadingShape], withheld: Iterable[str]
) -> list[str]:
    """The sensor messages that environments see.

    Args:
        sensors: names that were asked for; None: all.
        there: what the rig gives.
        withheld: those of which a stack of the campaign would be told nothing.

    Raises:
        UsageError: one is not there, or withheld, or named twice, or none is named; one line.
    """
    hidden = set(withheld)
    known = [name for name in there if name not in hidden]
    if sensors is None:
        return known
    if isinstance(sensors, str) or not sensors:
        raise UsageError(f"sensors: given {sensors!r}, allowed: a list of {', '.join(known)}")
    for name in sensors:
        if name in hidden:
            raise UsageError(
                f"sensors: '{name}' is truth that the campaign keeps from its stack; add "
                "'truth' to autonomy.tell"
            )
        if name not in there:
            raise UsageError(
                f"sensors: the campaign gives no '{name}'; {suggest(str(name), known)}, or add it "
                "with settings="
            )
        if list(sensors).count(name) > 1:
            raise UsageError(f"sensors: '{name}' is named twice; name each once")
    return list(sensors)


def space_of(names: Sequence[str], there: Mapping[str, ReadingShape]) -> spaces.Dict:
    """What one environment sees, by sensor message."""
    boxes: dict[str, spaces.Space[Any]] = {}
    for name in names:
        reading = there[name]
        boxes[name] = _box(reading.shape, reading.dtype)
        if reading.ragged:
            boxes[name + COUNT] = spaces.Box(0, reading.shape[0], (1,), np.int32)
    return spaces.Dict(boxes)


def _box(shape: tuple[int, ...], dtype: np.dtype[Any]) -> spaces.Box:
    if dtype.kind == "f":
        return spaces.Box(-np.inf, np.inf, shape, dtype.type)
    bounds = np.iinfo(dtype)
    return spaces.Box(bounds.min, bounds.max, shape, dtype.type)


class Observations:
    """Arrays of all environments, anew with every step: what was handed out is never written."""

    def __init__(
        self,
        names: Sequence[str],
        there: Mapping[str, ReadingShape],
        envs: int,
        device: str,
        form: ArrayForm,
    ) -> None:
        """Make room for what is handed out.

        Args:
            names: sensor messages.
            there: their shapes.
            envs: number of environments N.
            device: where the simulator computes.
            form: of the arrays that are handed out.
        """
        self._names = names
        self._there = there
        self._form = form
        self._on_device = form != "numpy" and device.startswith("cuda")
        self._device = device
        self._arrays: dict[str, Any] = {}
        for name in names:
            reading = there[name]
            self._keep(name, np.zeros((envs, *reading.shape), reading.dtype))
            if reading.ragged:
                self._keep(name + COUNT, np.zeros((envs, 1), np.int32))

    def update(self, told: Mapping[str, SensorData], active: NDArray[np.bool_]) -> None:
        """Take over readings; environments that are not active keep what they saw last.

        Args:
            told: readings by sensor message; those that are missing stay as they were.
            active: bool [N].
        """
        for name in self._names:
            if name in told:
                self._take(name, told[name], active)

    def handed_out(self) -> dict[str, Any]:
        """The arrays by name, [N, ...], in the form that was asked for."""
        if callable(self._form):
            return {name: self._form(array) for name, array in self._arrays.items()}
        return dict(self._arrays)

    def pictures(self, name: str) -> NDArray[Any]:
        """The arrays of a message on the host, [N, ...]."""
        array = self._arrays[name]
        return np.array(array.numpy() if self._on_device else array)

    def _take(self, name: str, data: SensorData, active: NDArray[np.bool_]) -> None:
        before = self._arrays[name]
        idle = np.flatnonzero(~active).tolist()
        if self._on_device and data.device is not None:
            array = wp.clone(data.device)
            for env in idle:
                wp.copy(array[env], before[env])
            self._arrays[name] = array
        else:
            values = np.array(data.values)
            if idle:
                values[idle] = before.numpy()[idle] if self._on_device else before[idle]
            self._keep(name, values)
        if data.count is not None:
            counts = np.array(data.count, np.int32).reshape(-1, 1)
            if idle:
                known = self._arrays[name + COUNT]
                counts[idle] = known.numpy()[idle] if self._on_device else known[idle]
            self._keep(name + COUNT, counts)

    def _keep(self, name: str, values: NDArray[Any]) -> None:
        """Values that lie on the host, where they are to lie."""
        self._arrays[name] = wp.array(values, device=self._device) if self._on_device else values


def _dtype(data: SensorData) -> np.dtype[Any]:
    if data.device is None:
        dtype: np.dtype[Any] = data.values.dtype
        return dtype
    return np.dtype(str(data.device.__cuda_array_interface__["typestr"]))
