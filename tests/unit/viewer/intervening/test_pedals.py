"""The keyboard of `viewer takeover`."""

from schemas.wire.interventions import Takeover
from viewer.intervening.pedals import STEERING_MAX_RAD, Pedals, keys


def press(text):
    pedals = Pedals()
    for key in text:
        pedals = pedals.press(key)
    return pedals


def test_keys_move_pedals_by_steps_and_stop_at_their_ends():
    assert press("www") == Pedals(throttle=0.3)
    assert press("w" * 50).throttle == 1.0
    assert press("wws") == Pedals(brake=0.25), "never both pedals"
    assert press("ssw") == Pedals(throttle=0.1)
    assert press("w ") == Pedals(brake=1.0)
    assert press("aad").steering_rad == 0.02
    assert press("d" * 99).steering_rad == -STEERING_MAX_RAD
    assert press("wax") == Pedals()
    assert press("w?") == press("w")
    assert press("wa").action() == Takeover(0.1, 0.0, 0.02)


def test_arrows_are_letters_and_an_escape_alone_is_one():
    assert keys(b"\x1b[A\x1bOBW\x1b[C\x1b[D q") == ["w", "s", "w", "d", "a", " ", "q"]
    assert keys(b"\x1b") == ["esc"]
    assert keys(b"\xff\x03") == ["ÿ", "\x03"]
    assert keys(b"") == []
