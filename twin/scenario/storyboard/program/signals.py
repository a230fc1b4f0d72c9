"""Controllers of traffic signals of a storyboard program (ASAM OpenSCENARIO XML 1.3, 6.11)."""

from __future__ import annotations

from twin.scenario.storyboard.program.record import ProgramRecord


class SignalState(ProgramRecord, frozen=True):
    """What a signal shows: the variable that holds its state, and the number of a word."""

    variable: int
    value: float


class SignalPhase(ProgramRecord, frozen=True):
    """A phase of a controller; signals that it does not name keep their states."""

    name: float
    """Number of the word."""
    duration_s: float
    """Infinite: the last one."""
    states: tuple[SignalState, ...]


class SignalController(ProgramRecord, frozen=True):
    """Phases that follow one another, the first after the last, from time 0 on."""

    name: str
    variable: int
    """Holds the name of its phase."""
    delay_s: float
    """How long after time 0 its first phase virtually begins; before, it is in the phase that it
    would be in had it always run."""
    phases: tuple[SignalPhase, ...]
