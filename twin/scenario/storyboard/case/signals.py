"""Traffic lights of cases: which lamps are on, from the states that their scenarios have given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.scenario.storyboard.program.program import Program
from twin.scenario.storyboard.program.signal_states import lamps_of_state

_PREFIX = "signal "
"""Before the id of a signal in the name of the variable with its state."""


class ProgramSignals:
    """The traffic lights of a world whose states a program knows."""

    def __init__(self, program: Program, signals: Sequence[str]) -> None:
        """``signals``: ids of :attr:`twin.world.street.build.World.signals`."""
        names = {variable.name: k for k, variable in enumerate(program.variables)}
        known = [k for k, signal in enumerate(signals) if _PREFIX + signal in names]
        self.columns = np.array(known, np.int64)
        """Which of the world's."""
        self.variables = np.array([names[_PREFIX + signals[k]] for k in known], np.int64)
        """Their variables."""
        self._lamps = np.array([lamps_of_state(word) or 0 for word in program.words] or [0])

    def lamps(self, values: np.ndarray) -> np.ndarray:
        """Bits of the lamps that are on of each traffic light.

        Args:
            values: of all variables of a slot [V].
        """
        return self._lamps[values[self.variables].astype(np.int64)]
