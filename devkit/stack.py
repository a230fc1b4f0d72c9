"""The public interface of an autonomy stack, and how one is found by its entry point.

A stack drives S cars at once, one per slot. The host hands it every sensor of one instant as arrays
with the slot index first; the stack answers with one command per active slot. A stack that brakes
for anything nearer than ``gap_m``, complete::

    from devkit.stack import Observation, Stack
    from schemas.messages import BOX_COLUMNS, Command, Episode

    DISTANCE = BOX_COLUMNS.index("distance_m")

    class GapStack(Stack):
        def __init__(self, slots: int, *, gap_m: float = 15.0) -> None:
            self.gap_m = gap_m
            self.braking = [False] * slots

        def reset(self, slot: int, episode: Episode) -> None:
            self.braking[slot] = False

        def step(self, observation: Observation) -> list[Command]:
            return [self.drive(slot, observation) for slot in observation.active_slots()]

        def drive(self, slot: int, observation: Observation) -> Command:
            boxes = observation.boxes(slot)
            if boxes is not None:
                self.braking[slot] |= bool((boxes[:, DISTANCE] < self.gap_m).any())
            return Command(
                slot=slot,
                token=int(observation.token[slot]),
                tick=int(observation.tick[slot]),
                throttle=0.0 if self.braking[slot] else 0.3,
                brake=1.0 if self.braking[slot] else 0.0,
                steering_rad=0.0,
                aeb=self.braking[slot],
            )

Name it ``autonomy.stack: my_module:GapStack`` in the campaign file, its keyword arguments under
``autonomy.parameters``.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import msgspec
import numpy as np

from schemas.messages import Command, Episode, PerceptionCost
from schemas.validation import convert_all, suggest
from schemas.wire.expected import Expected
from schemas.wire.topics import reads_mistake
from twin.sandbox.inside import is_inside

ParameterValue = bool | int | float | str
"""What a campaign file may hand to a stack's constructor."""

_METHODS = ("reset", "step", "close")


class StackError(ValueError):
    """The stack cannot be loaded or used; the message is one line for the user."""


class StackMissingError(StackError):
    """There is no such stack here, or not what it needs that some machines lack: another machine
    may have it, and the same one later."""


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Everything the sensors of all slots saw at one instant. Read it, never write to it.

    The arrays may be views of memory that the simulator reuses after the answer to this ``seq``:
    copy what is to be kept.
    """

    seq: int
    """Rig tick: counts every exchange, whatever the cases do."""
    active: np.ndarray
    """bool [S]: the slots that run a case; the others hold zeros in every array."""
    token: np.ndarray
    """int64 [S]: identifies the attempt; echo it in the command."""
    tick: np.ndarray
    """int32 [S]: case tick, 0 at reset; echo it in the command."""
    sim_time_ns: np.ndarray
    """int64 [S]: sim time since reset [ns]."""
    sensors: Mapping[str, np.ndarray]
    """Sensor name -> array [S, ...]; a sensor that is not due at this seq is absent.

    ``camera``: uint8 [S, H, W, 3], RGB. ``boxes``: float32 [S, B, 7], columns
    ``schemas.messages.BOX_COLUMNS``, with every camera frame. ``vehicle``: float64 [S, 7], columns
    ``VEHICLE_COLUMNS``. ``environment``: float64 [S, 2], columns ``ENVIRONMENT_COLUMNS``.

    If the campaign's section ``sensors`` names them: ``encoders``: int64 [S, 4], columns
    ``ENCODER_COLUMNS``. ``gnss``: float64 [S, 4], columns ``GNSS_COLUMNS``, NaN where ``fix`` is 0.
    ``imu``: float64 [S, 6], columns ``IMU_COLUMNS``.
    """
    counts: Mapping[str, np.ndarray]
    """Sensor name -> int [S]: valid rows per slot of ragged sensors (``boxes``)."""

    def active_slots(self) -> list[int]:
        """Indices of the active slots, ascending."""
        return [int(slot) for slot in np.flatnonzero(self.active)]

    def boxes(self, slot: int) -> np.ndarray | None:
        """Valid box rows of ``slot``, float32 [n, 7]; None when no camera frame is due."""
        if "boxes" not in self.sensors:
            return None
        return self.sensors["boxes"][slot, : int(self.counts["boxes"][slot])]


class Stack(ABC):
    """An autonomy stack for ``slots`` cars.

    ``takes_device_frames``, said by a class itself and not inherited: arrays of cameras and lidars
    may come as objects in a GPU's memory (``__cuda_array_interface__``, ``shape``, ``dtype``, and
    ``host()``, which copies them to a NumPy array), if the simulator's GPU is there; otherwise all
    arrays are NumPy's.

    Two rules make its verdicts reproducible. *Deterministic*: no wall clock, no unseeded random
    numbers, no state that outlives :meth:`reset`. *Slot independent*: what it asks of a car is the
    same to the last bit whatever the slot, the number of slots and the neighbours; so a network
    runs at a fixed batch size, never at S.
    """

    drives_by_camera: ClassVar[bool] = False
    """Whether it cannot drive where ``render`` is false; such a campaign is refused before it
    runs."""
    portable: ClassVar[bool] = False
    """Whether it asks the same of a car, to the last bit, on every CPU and beside every GPU; said
    by a class itself and not inherited. NumPy's and C's functions beside +, -, x, / and square
    roots, its matrix products and float networks differ between machines."""
    reads: ClassVar[tuple[str, ...] | None] = None
    """Sensor messages that it looks at, as ``("vehicle", "camera", "boxes")``; None: all. It gets
    no others, and pictures and points that nobody looks at are not made. Said by a class itself and
    not inherited, because a class that derives from another may look at more."""
    PARAMETERS: ClassVar[tuple[type[msgspec.Struct], ...]] = ()
    """Structs whose fields are parameters, of a class that takes ``**parameters`` and hands them to
    :func:`parameter_parts`."""

    def __init__(self, slots: int) -> None:
        """Build the stack once per rig.

        Subclasses list their parameters as keyword-only arguments with defaults, or by
        :attr:`PARAMETERS`; those are the keys allowed in ``autonomy.parameters``. Raise ValueError
        with one sentence for a bad value.

        Args:
            slots: number of slots S, at least 1.
        """
        self.slots = slots

    def expect(self, expected: Sequence[Expected]) -> None:  # noqa: B027 - optional
        """What cases of this rig will look with, as far as it is known; called once, before all
        else, while the simulator is not ready: the time to load networks. Optional, and no promise:
        others may come. What cannot be loaded is told by :meth:`reset`."""

    @abstractmethod
    def reset(self, slot: int, episode: Episode) -> None:
        """A new case begins in ``slot``: forget the old one. Called before its first ``step``."""

    @abstractmethod
    def step(self, observation: Observation) -> list[Command]:
        """Answer one instant.

        Returns:
            One command per active slot, in any order, echoing slot, token and tick. An exception
            is the outcome of the case, ``failed`` with what was raised; if the rig drives several,
            each is tried again until one raises by itself.
        """

    def costs(self) -> list[PerceptionCost | None]:
        """Wall time that perception took in the last :meth:`step`, for the report: one entry per
        command that it returned, None where no frame was looked at. Times of other stages, and
        what limits its sensors, go with the next of them. Optional."""
        return []

    def close(self) -> None:  # noqa: B027 - optional: most stacks hold nothing to release
        """Release what the stack holds; nothing is called afterwards."""


def load_stack(entry_point: str, slots: int, parameters: Mapping[str, ParameterValue]) -> Stack:
    """Import and construct the stack named ``module:Class``.

    Raises:
        StackMissingError: no such module on the path, or it imports OpenCV, which is not here.
        StackError: one line that says what was given, what is allowed and whose mistake it is; its
            cause is what the stack raised, if it did.
    """
    stack_class = _find(entry_point)
    if slots < 1:
        raise StackError(f"{entry_point}: given {slots} slots, at least 1 needed")
    _check_names(entry_point, stack_class, parameters)
    mistake = _reads_mistake(stack_class)
    if mistake:
        raise StackError(f"{entry_point}: {mistake}")
    try:
        return stack_class(slots, **parameters)
    except Exception as error:
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise StackError(f"{entry_point}: {kind}{_first_line(error)}") from error


def reads_of(stack_class: type[Any]) -> frozenset[str] | None:
    """Sensor messages that a stack looks at; None: all."""
    reads = vars(stack_class).get("reads")
    return None if reads is None else frozenset(reads)


def _reads_mistake(stack_class: type[Any]) -> str:
    """What is wrong with ``reads``, or an empty string."""
    reads = vars(stack_class).get("reads")
    if reads is None:
        return ""
    if not isinstance(reads, (tuple, list, set, frozenset)):
        kind = type(reads).__name__
        return f"reads is of type {kind}; allowed: a tuple of sensor messages, or None for all"
    return reads_mistake(reads)


def looked_at(sensors: Mapping[str, Any], stack_class: type[Any]) -> Mapping[str, Any]:
    """The arrays of a tick that a stack looks at: also where others are there, in a
    recorded drive for example, it must not come to see more."""
    reads = reads_of(stack_class)
    if reads is None:
        return sensors
    shown = {name: array for name, array in sensors.items() if name in reads}
    return _Shown(shown, stack_class.__name__, reads)


class _Shown(dict[str, Any]):
    """Arrays of the messages that a stack looks at; another is a mistake that is named."""

    def __init__(self, arrays: Mapping[str, Any], stack: str, reads: frozenset[str]) -> None:
        super().__init__(arrays)
        self._stack, self._reads = stack, reads

    def __missing__(self, name: str) -> Any:
        if name in self._reads:
            raise KeyError(name)
        known = ", ".join(sorted(self._reads)) or "none"
        raise KeyError(f"{name}: {self._stack} says that it reads {known}; add it to `reads`")


ONLY_NAMED = "in its sandbox a stack sees what import statements and autonomy.files name"
"""Why a module may be missing that is there."""


def _find(entry_point: str) -> type[Stack]:
    module_name, colon, class_name = entry_point.partition(":")
    if not (module_name and colon and class_name):
        raise StackError(f"stack {entry_point!r}: expected module:Class")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name == "cv2" and importlib.util.find_spec("cv2") is None:
            raise StackMissingError(
                f"{module_name}: it imports cv2, and OpenCV is not installed here; "
                "pip install 'drivetwin-worker[networks]'"
            ) from None
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            sandbox_hint = f"; {ONLY_NAMED}" if is_inside() else ""
            raise StackError(
                f"{module_name}: import failed: {_first_line(error)}{sandbox_hint}"
            ) from error
        raise StackMissingError(
            f"stack {entry_point!r}: no module named {error.name!r}; "
            "install it, or add its folder to PYTHONPATH"
        ) from None
    except Exception as error:
        kind = type(error).__name__
        raise StackError(f"{module_name}: import failed: {kind}: {_first_line(error)}") from error
    stack_class = getattr(module, class_name, None)
    if not inspect.isclass(stack_class):
        classes = sorted(
            name
            for name, value in vars(module).items()
            if inspect.isclass(value)
            and value.__module__ == module.__name__
            and not name.startswith("_")
        )
        hint = suggest(class_name, classes) if classes else "it defines none"
        raise StackError(f"stack {entry_point!r}: no class {class_name!r} in the module; {hint}")
    missing = [name for name in _METHODS if not callable(getattr(stack_class, name, None))]
    if missing:
        raise StackError(
            f"stack {entry_point!r}: not a stack, without {', '.join(missing)}; "
            "derive it from devkit.stack:Stack"
        )
    return cast(type[Stack], stack_class)


def parameter_parts(
    parts: Sequence[type[msgspec.Struct]], parameters: Mapping[str, ParameterValue]
) -> list[Any]:
    """One struct of every type, from the parameters that are its fields.

    Raises:
        TypeError: a parameter is a field of none.
        ValueError: a value is not allowed; one line.
    """
    if unknown := {*parameters} - {name for part in parts for name in fields_of(part)}:
        raise TypeError(f"unexpected parameter '{min(unknown)}'")
    made = []
    for part in parts:
        values = {name: parameters[name] for name in fields_of(part) if name in parameters}
        value, mistakes = convert_all(values, part)
        if value is None:
            raise ValueError(mistakes[0].line("autonomy.parameters"))
        made.append(value)
    return made


def fields_of(part: type[msgspec.Struct]) -> tuple[str, ...]:
    """Names of its fields, as campaigns write them."""
    return part.__struct_fields__


def _check_names(
    entry_point: str, stack_class: type[Stack], parameters: Mapping[str, ParameterValue]
) -> None:
    """Unknown and missing keyword arguments, found before Python's TypeError would say less."""
    signature = list(inspect.signature(stack_class).parameters.values())
    keywords = [p for p in signature if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    allowed = [p.name for p in keywords if p.name != "slots"]
    listed = [name for part in vars(stack_class).get("PARAMETERS", ()) for name in fields_of(part)]
    if listed or not any(p.kind == p.VAR_KEYWORD for p in signature):
        allowed += listed
        for name in parameters:
            if name not in allowed:
                hint = suggest(name, allowed) if allowed else "it takes none"
                raise StackError(f"{entry_point}: unknown parameter '{name}'; {hint}")
    for parameter in keywords:
        needed = parameter.name in allowed and parameter.default is parameter.empty
        if needed and parameter.name not in parameters:
            raise StackError(f"{entry_point}: parameter '{parameter.name}' is missing")


def _first_line(error: BaseException) -> str:
    """A message that stays one line whatever a foreign stack raised."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__
