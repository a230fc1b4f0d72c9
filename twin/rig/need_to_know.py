"""What a stack gets to see of what the simulator knows: no more than its campaign gives it.

Boxes and the exact environment are truth. In a slot whose case gives none, the rows of its boxes
are empty, and the environment comes in steps, as a car's light and visibility sensor would tell it.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from schemas.case import Case
from schemas.identity import is_told_truth
from twin.sensors.data import SensorData

ILLUMINANCE_STEPS_LX = tuple(m * 10.0**e for e in range(-3, 6) for m in (1.0, 2.0, 5.0))
"""Between which it is told how bright it is [lx]."""

EXTINCTION_STEPS_PER_M = (0.001, 0.002, 0.003, 0.0045, 0.006, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Between which it is told how far one sees [1/m]; two of them are those of a car's fog lamps."""

_STEPS = (ILLUMINANCE_STEPS_LX, EXTINCTION_STEPS_PER_M)
_TRUTH = ("boxes", "environment")


def as_told(sensed: dict[str, SensorData], cases: Sequence[Case | None]) -> dict[str, SensorData]:
    """The readings as the stack gets them.

    Args:
        sensed: by the engine, for all slots.
        cases: of the slots; None: nothing runs there.
    """
    told_truth = np.array([case is None or is_told_truth(case) for case in cases])
    if told_truth.all():
        return sensed
    return {
        name: _without(name.partition(".")[0], data, told_truth) for name, data in sensed.items()
    }


def is_withheld(name: str, case: Case) -> bool:
    """Whether the stack of a case is told nothing by a sensor message."""
    return name.partition(".")[0] == "boxes" and not is_told_truth(case)


def _without(kind: str, data: SensorData, told_truth: NDArray[np.bool_]) -> SensorData:
    if kind not in _TRUTH:
        return data
    shown = data.values.copy()
    if kind == "environment":
        for column, steps in enumerate(_STEPS):
            shown[~told_truth, column] = stepped(shown[~told_truth, column], steps)
        return SensorData(shown)
    assert data.count is not None
    shown[~told_truth] = 0
    return SensorData(shown, np.where(told_truth, data.count, 0).astype(data.count.dtype))


def stepped(values: NDArray[np.float64], steps: tuple[float, ...]) -> NDArray[np.float64]:
    """Values as the middles of the two steps that they lie between; on a step a value stays."""
    edges, middles = _scale(steps)
    above = edges.searchsorted(values, side="right").clip(1, len(edges) - 1)
    stays = (values == edges[above - 1]) | (values == edges[above]) | (values == 0)
    return np.where(stays, values, middles[above])


@functools.cache
def _scale(steps: tuple[float, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps with one more at each end, and the middle below each of them; asked in every tick."""
    edges = np.array([steps[0] / 2, *steps, steps[-1] * 2])
    return edges, np.sqrt(np.append(edges[0], edges[:-1]) * edges)
