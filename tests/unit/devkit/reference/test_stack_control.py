"""devkit.reference.control: cruise and full brake."""

from __future__ import annotations

import pytest

from devkit.reference.control import Actuation, Controller, control
from devkit.reference.planning import DrivePlan

CONTROLLER = Controller()
CRUISE = DrivePlan(speed_mps=8.0, aeb=False)
AEB = DrivePlan(speed_mps=0.0, aeb=True)


def one(plan: DrivePlan, speed_mps: float, integral: float = 0.0) -> Actuation:
    return control(integral, plan, speed_mps, 0.05, CONTROLLER)[1]


def test_aeb_is_full_brake_at_any_speed_and_clears_the_integral():
    for speed_mps in (0.0, 0.01, 8.0, 30.0):
        assert control(0.3, AEB, speed_mps, 0.05, CONTROLLER) == (0.0, Actuation(0.0, 1.0))


def test_throttle_is_limited():
    assert one(CRUISE, 0.0) == Actuation(0.6, 0.0)
    assert one(CRUISE, 8.0) == Actuation(0.0, 0.0)
    assert one(CRUISE, 7.0).throttle == pytest.approx(0.3 + 0.05 * 0.05)


def test_gentle_brake_beyond_the_overspeed_only():
    assert one(CRUISE, 8.5) == Actuation(0.0, 0.0)
    assert one(CRUISE, 9.5).brake == pytest.approx(0.1)
    assert one(CRUISE, 30.0) == Actuation(0.0, 0.2)


def test_never_throttle_and_brake_together():
    for decimetres in range(200):
        for integral in (0.0, 0.3, 0.6):
            actuation = one(CRUISE, decimetres / 10, integral)
            assert actuation.throttle == 0.0 or actuation.brake == 0.0
            assert 0.0 <= actuation.throttle <= 0.6
            assert 0.0 <= actuation.brake <= 0.2


@pytest.mark.parametrize("speed_mps", [0.0, 12.0])
def test_no_wind_up_while_the_throttle_is_at_a_limit(speed_mps):
    assert control(0.3, CRUISE, speed_mps, 0.05, CONTROLLER)[0] == 0.3


def test_reaches_and_keeps_the_cruise_speed_of_a_car_with_drag():
    speed_mps, integral, fastest_mps = 0.0, 0.0, 0.0
    for _ in range(1200):
        integral, actuation = control(integral, CRUISE, speed_mps, 0.05, CONTROLLER)
        drag_mps2 = 0.3 + 0.004 * speed_mps**2
        speed_mps += 0.05 * (4.0 * actuation.throttle - 6.0 * actuation.brake - drag_mps2)
        speed_mps = max(speed_mps, 0.0)
        fastest_mps = max(fastest_mps, speed_mps)
    assert speed_mps == pytest.approx(8.0, abs=0.05)
    assert fastest_mps < 8.5


def test_cruise_by_throttle_is_constant_and_yields_to_the_brake():
    by_throttle = Controller(cruise="throttle")
    for speed_mps in (0.0, 8.0, 30.0):
        assert control(0.0, CRUISE, speed_mps, 0.05, by_throttle) == (0.0, Actuation(0.2, 0.0))
        assert control(0.0, AEB, speed_mps, 0.05, by_throttle) == (0.0, Actuation(0.0, 1.0))
    stronger = Controller(cruise="throttle", cruise_throttle=0.35)
    assert control(0.0, CRUISE, 3.0, 0.05, stronger)[1].throttle == 0.35


def test_parameters_that_would_be_ignored_are_refused():
    with pytest.raises(ValueError, match="cruise_throttle is set, but cruise: speed"):
        Controller(cruise_throttle=0.3)
    with pytest.raises(ValueError, match="overspeed_mps is set, but cruise: throttle"):
        Controller(cruise="throttle", overspeed_mps=1.0)
