"""Commands of ROS 2 -> the drive plane's command, for one car and case. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from devkit.bridges.ros2.controllers import AskedMotion, MotionControl, press
from schemas.messages import Command, Lights
from twin.ros2.commands import (
    AckermannDemand,
    Demand,
    GearDemand,
    IndicatorDemand,
    PlainDrive,
    TwistDemand,
)

_GEARS = ("park", "neutral", "reverse", "drive")
"""Where several topics select a gear, the first of these counts."""
_HAZARD = 3


@dataclass(frozen=True, slots=True)
class AskedTick:
    """What is answered."""

    slot: int
    token: int
    tick: int
    speed_mps: float
    """Forward speed of the car [m/s]."""


class TickMistakeError(ValueError):
    """A command names another tick than its stamp does; one line."""


class RosDriver:
    """Makes commands of one case."""

    def __init__(
        self, control: MotionControl, period_s: float, aeb_brake: float, *, exact: bool = True
    ) -> None:
        """A case begins.

        Args:
            control: parameters of the controller.
            period_s: control period [s].
            aeb_brake: brake that counts as emergency braking, where a command does not say it.
            exact: a plain command has to be for the tick that is answered; false: it is in force
                until another comes.
        """
        self._control, self._period_s, self._aeb_brake = control, period_s, aeb_brake
        self._exact = exact
        self._integral = 0.0

    def command(self, main: str, demands: Mapping[str, Demand], now: AskedTick) -> Command:
        """The drive plane's command.

        Args:
            main: topic of the command that moves the car.
            demands: commands in force by topic.
            now: what is answered.

        Raises:
            AskedError: a number is none.
            TickMistakeError: a plain command names another tick.
        """
        asked = demands.get(main)
        if isinstance(asked, PlainDrive):
            return self._plain(asked.command, now)
        motion = motion_of(asked)
        selected = {each.gear for each in demands.values() if isinstance(each, GearDemand)}
        self._integral, pedals = press(
            *(self._integral, motion, now.speed_mps, self._period_s, self._control),
            gear=next((gear for gear in _GEARS if gear in selected), ""),
        )
        return Command(
            slot=now.slot,
            token=now.token,
            tick=now.tick,
            throttle=pedals.throttle,
            brake=pedals.brake,
            steering_rad=pedals.steering_rad,
            aeb=pedals.brake >= self._aeb_brake,
            lights=Lights(indicators=_indicators(demands)),
            reverse=pedals.reverse,
        )

    def _plain(self, command: Command, now: AskedTick) -> Command:
        if self._exact and command.tick != now.tick:
            raise TickMistakeError(
                f"the command with the stamp of tick {now.tick} says it is for tick {command.tick}"
            )
        return msgspec.structs.replace(command, slot=now.slot, token=now.token, tick=now.tick)


def motion_of(demand: Any) -> AskedMotion:
    """What a command asks for; before the first one, to stand."""
    if isinstance(demand, AckermannDemand):
        return AskedMotion(demand.speed_mps, demand.accel_mps2 or 0.0, demand.steering_rad)
    if isinstance(demand, TwistDemand):
        return AskedMotion(demand.speed_mps, yaw_rate_radps=demand.yaw_rate_radps)
    return AskedMotion(0.0, steering_rad=0.0)


def _indicators(demands: Mapping[str, Demand]) -> int:
    """Hazard lights go before turn indicators."""
    turn = hazard = 0
    for each in demands.values():
        if isinstance(each, IndicatorDemand) and each.indicators is not None:
            if each.hazard:
                hazard = each.indicators
            else:
                turn = each.indicators
    return hazard if hazard == _HAZARD else turn
