"""Lamps of the bodies of cases, from what their scenarios have switched so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.actors.lamps import VehicleLamp
from twin.scenario.storyboard.program.actions import LIGHTS, LampMode, LightAction

_SHIFTS = 2 * np.arange(len(LIGHTS))
"""Where the mode of each lamp stands in :attr:`Whole.LIGHTS`."""
_LAMPS = {
    "daytimeRunningLights": (VehicleLamp.HEAD,),
    "lowBeam": (VehicleLamp.HEAD, VehicleLamp.TAIL),
    "highBeam": (VehicleLamp.HEAD, VehicleLamp.TAIL, VehicleLamp.HIGH_BEAM),
    "fogLights": (VehicleLamp.FOG_FRONT, VehicleLamp.FOG_REAR),
    "fogLightsFront": (VehicleLamp.FOG_FRONT,),
    "fogLightsRear": (VehicleLamp.FOG_REAR,),
    "warningLights": (VehicleLamp.INDICATOR_LEFT, VehicleLamp.INDICATOR_RIGHT),
    "indicatorLeft": (VehicleLamp.INDICATOR_LEFT,),
    "indicatorRight": (VehicleLamp.INDICATOR_RIGHT,),
    "reversingLights": (VehicleLamp.REVERSING,),
}
_BITS = np.array([sum(1 << lamp for lamp in _LAMPS.get(name, ())) for name in LIGHTS])
"""Bits of what shines of each lamp."""
_LOW, _BRAKE = LIGHTS.index("lowBeam"), LIGHTS.index("brakeLights")
_REVERSING = LIGHTS.index("reversingLights")
_FLASH_MIN_S = 1e-3


@dataclass(frozen=True, slots=True)
class LampsShown:
    """Lamps of bodies [S, M]."""

    lamps: np.ndarray
    """bool: head and tail lamps are on by night."""
    brake: np.ndarray
    """bool"""
    lights: np.ndarray
    """int32, bit of each :class:`VehicleLamp` that is on."""


class SlotLamps:
    """When the lamps of all slots began to flash, arrays [S, M, lamps]."""

    def __init__(self, slots: int, room: int, step_s: float) -> None:
        self._step_s = step_s
        shape = slots, room, len(LIGHTS)
        self._since = np.zeros(shape, np.int64)
        self._on_s = np.ones(shape)
        self._period_s = np.ones(shape)

    def begin(self, slot: int) -> None:
        """A case begins: nothing flashes."""
        self._since[slot] = 0
        self._on_s[slot] = self._period_s[slot] = 1.0

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """When the lamps of a slot began to flash, copied."""
        names = ("_since", "_on_s", "_period_s")
        return {name: getattr(self, name)[slot].copy() for name in names}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on with that."""
        for name, values in saved.items():
            getattr(self, name)[slot] = values

    def switch(self, slot: int, row: int, action: LightAction, step: int) -> None:
        """A body's lamp does what an action says from a step on."""
        at = slot, row, action.light
        self._since[at] = step
        self._on_s[at] = max(0.0, action.on_s)
        self._period_s[at] = max(_FLASH_MIN_S, self._on_s[at] + max(0.0, action.off_s))

    def shown(
        self,
        modes: np.ndarray,
        lit: np.ndarray,
        slows: np.ndarray,
        backwards: np.ndarray,
        step: np.ndarray,
    ) -> LampsShown:
        """What shines now; lamps that a scenario says nothing of follow the body's motion.

        Args:
            modes: :attr:`Whole.LIGHTS` of the bodies [S, M].
            lit: whether it has lamps.
            slows: whether it slows down.
            backwards: whether it drives backwards.
            step: steps of each slot so far [S].
        """
        usual = np.where(lit & backwards, 1 << VehicleLamp.REVERSING, 0).astype(np.int32)
        if not modes.any():
            return LampsShown(lit, lit & slows, usual)
        mode = modes[..., None] >> _SHIFTS & 3
        time_s = (step[:, None, None] - self._since) * self._step_s
        # A nanosecond is more than rounding does to these times, and far less than a step.
        phase_s = np.mod(time_s + 1e-9, self._period_s)
        on = (mode == LampMode.ON) | ((mode == LampMode.FLASHING) & (phase_s < self._on_s))
        on &= lit[..., None]
        said = mode != LampMode.UNSAID
        lights = np.bitwise_or.reduce(np.where(on, _BITS, 0), axis=-1).astype(np.int32)
        lights |= np.where(said[..., _REVERSING], 0, usual)
        return LampsShown(
            lit & np.where(said[..., _LOW], on[..., _LOW], True),
            lit & np.where(said[..., _BRAKE], on[..., _BRAKE], slows),
            lights,
        )
