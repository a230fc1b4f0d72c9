"""Keys of a keyboard -> pedals and steering wheel. No terminal, no clock.

Terminals tell that a key was pressed and not that it was let go, so every press moves something by
a step, and it stays there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from schemas.wire.interventions import Takeover

THROTTLE_STEP = 0.1
BRAKE_STEP = 0.25
STEERING_STEP_RAD = 0.02
STEERING_MAX_RAD = 0.5

HELP = (
    "W or Up: throttle, S or Down: brake, A or Left, D or Right: steer, X: straight and no pedal, "
    "Space: full brake, P: pause or go on, N: one tick, Q or Esc: give back"
)

_ARROWS = {b"A": "w", b"B": "s", b"C": "d", b"D": "a"}
"""Last byte of the arrows' escape sequences."""


@dataclass(frozen=True, slots=True)
class Pedals:
    """Pedals and steering wheel as the driver holds them."""

    throttle: float = 0.0
    brake: float = 0.0
    steering_rad: float = 0.0
    """Left positive [rad]."""

    def press(self, key: str) -> Pedals:
        """After a key, one of ``wasdx `` ; others change nothing."""
        match key:
            case "w":
                return replace(self, throttle=_up(self.throttle, THROTTLE_STEP), brake=0.0)
            case "s":
                return replace(self, throttle=0.0, brake=_up(self.brake, BRAKE_STEP))
            case " ":
                return replace(self, throttle=0.0, brake=1.0)
            case "a":
                return self._steer(STEERING_STEP_RAD)
            case "d":
                return self._steer(-STEERING_STEP_RAD)
            case "x":
                return Pedals()
        return self

    def action(self) -> Takeover:
        """Action for the simulator."""
        return Takeover(self.throttle, self.brake, self.steering_rad)

    def _steer(self, step_rad: float) -> Pedals:
        turned = round(self.steering_rad + step_rad, 3)
        return replace(self, steering_rad=max(-STEERING_MAX_RAD, min(STEERING_MAX_RAD, turned)))


def keys(data: bytes) -> list[str]:
    """What a terminal sent as keys: lower case letters, ``esc``; arrows are ``wasd``."""
    pressed = []
    while data:
        if data[:2] in (b"\x1b[", b"\x1bO") and data[2:3] in _ARROWS:
            pressed.append(_ARROWS[data[2:3]])
            data = data[3:]
        elif data[:1] == b"\x1b":
            pressed.append("esc")
            data = data[1:]
        else:
            pressed.append(data[:1].decode("latin-1").lower())
            data = data[1:]
    return pressed


def _up(value: float, step: float) -> float:
    return min(1.0, round(value + step, 3))
