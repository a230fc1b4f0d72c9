"""Pictures of traffic signs as sheets of one colour each, bottom first.

The pictures follow the German catalogue (VzKat 2017) in simple shapes: outlines to the right and up
as seen from the front, in metres at the usual size of each sign, around its middle.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from twin.road.opendrive.furniture import RoadSignal
from twin.world.meshes.mesh import Color
from twin.world.street.signs import BLACK, BLUE, RED, WHITE, YELLOW

_GREY: Color = (0.45, 0.46, 0.46)

_BARS = {
    "0": "abcdef",
    "1": "bc",
    "2": "abged",
    "3": "abgcd",
    "4": "fgbc",
    "5": "afgcd",
    "6": "afgedc",
    "7": "abc",
    "8": "abcdefg",
    "9": "abcdfg",
}
"""Bars of a digit: a at the top, then clockwise, g in the middle."""


@dataclass(frozen=True, slots=True)
class PlateSheet:
    """A sheet: its outline [N, 2], convex, and its colour."""

    outline: np.ndarray
    color: Color
    lifted: bool = True
    """False: in the same layer as the sheet before."""


@dataclass(frozen=True, slots=True)
class SignPicture:
    """The sheets of a sign; the first one is its plate."""

    sheets: tuple[PlateSheet, ...]

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of its plate."""
        span = np.ptp(self.sheets[0].outline, axis=0)
        return float(span[0]), float(span[1])

    @property
    def middle_m(self) -> float:
        """Height of the middle of its plate's extent above the middle of the picture."""
        up = self.sheets[0].outline[:, 1]
        return float(0.5 * (up.min() + up.max()))


def ring(radius_m: float, sides: int = 20, turn: float = 0.0) -> np.ndarray:
    """A regular polygon [sides, 2] with a corner at the top."""
    angle = 2.0 * np.pi * np.arange(sides) / sides + turn
    return radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def bar(right: float, up: float, half_width: float, half_height: float) -> np.ndarray:
    """A rectangle [4, 2] around a point."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (half_width, half_height)
    return corners + np.array((right, up))


def _round(border: Color, inside: Color, *more: PlateSheet) -> SignPicture:
    return SignPicture((PlateSheet(ring(0.30), border), PlateSheet(ring(0.235), inside), *more))


def _digits(text: str) -> list[PlateSheet]:
    """A number of up to three digits, in one layer."""
    sheets: list[PlateSheet] = []
    wide = 0.052 if len(text) < 3 else 0.036
    tall, thick = 0.052, 0.014
    pitch = 2.0 * wide + 0.06
    for index, digit in enumerate(text):
        right = pitch * (index - 0.5 * (len(text) - 1))
        across, along = (wide + thick, thick), (thick, tall + thick)
        places = {
            "a": bar(right, 2 * tall, *across),
            "b": bar(right + wide, tall, *along),
            "c": bar(right + wide, -tall, *along),
            "d": bar(right, -2 * tall, *across),
            "e": bar(right - wide, -tall, *along),
            "f": bar(right - wide, tall, *along),
            "g": bar(right, 0.0, *across),
        }
        sheets += [PlateSheet(places[name], BLACK, not sheets) for name in _BARS[digit]]
    return sheets


def _speed_limit(text: str) -> SignPicture:
    return _round(RED, WHITE, *_digits(text))


def _stop() -> SignPicture:
    octagon = ring(0.40, 8, np.pi / 8)
    sheets = [
        PlateSheet(octagon, WHITE),
        PlateSheet(octagon * 0.93, RED),
    ]
    letters = (
        [(0, 2, 1, 0.3), (-1, 1, 0.3, 1), (0, 0, 1, 0.3), (1, -1, 0.3, 1), (0, -2, 1, 0.3)],
        [(0, 2, 1.2, 0.3), (0, 0, 0.3, 2)],
        [(0, 2, 1, 0.3), (0, -2, 1, 0.3), (-1, 0, 0.3, 2.2), (1, 0, 0.3, 2.2)],
        [(-1, 0, 0.3, 2.2), (0, 2, 1, 0.3), (0, 0, 1, 0.3), (1, 1, 0.3, 1)],
    )
    for number, letter in enumerate(letters):
        for stroke, (x, y, w, h) in enumerate(letter):
            middle = 0.165 * (number - 1.5) + 0.05 * x
            outline = bar(middle, 0.055 * y, 0.05 * w, 0.055 * h)
            sheets.append(PlateSheet(outline, WHITE, number == stroke == 0))
    return SignPicture(tuple(sheets))


def _triangle(*more: PlateSheet, on_its_tip: bool = False) -> SignPicture:
    outline = ring(0.52, 3, np.pi / 3 if on_its_tip else 0.0)
    return SignPicture((PlateSheet(outline, RED), PlateSheet(outline * 0.68, WHITE), *more))


def _priority() -> SignPicture:
    diamond = ring(0.42, 4)
    return SignPicture((PlateSheet(diamond, WHITE), PlateSheet(diamond * 0.72, YELLOW)))


def _crossing() -> SignPicture:
    square = bar(0.0, 0.0, 0.30, 0.30)
    walker = (
        [(-0.03, -0.07), (0.03, -0.07), (0.035, 0.03), (-0.025, 0.03)],
        [(0.0, -0.07), (0.035, -0.06), (0.085, -0.17), (0.05, -0.18)],
        [(-0.03, -0.06), (0.005, -0.07), (-0.06, -0.18), (-0.095, -0.17)],
    )
    sheets = [
        PlateSheet(square, WHITE),
        PlateSheet(square * 0.95, BLUE),
        PlateSheet(ring(0.29, 3) + np.array((0.0, -0.05)), WHITE),
        PlateSheet(ring(0.03, 8) + np.array((0.01, 0.07)), BLACK),
    ]
    sheets += [PlateSheet(np.array(outline), BLACK, False) for outline in walker]
    return SignPicture(tuple(sheets))


def _stroke(half_width: float, half_height: float) -> np.ndarray:
    """A bar that is turned by 45 degrees: a wide one leads down to the right, a tall one up."""
    turn = np.array([(0.7071, -0.7071), (0.7071, 0.7071)])
    return bar(0.0, 0.0, half_width, half_height) @ turn


_MARK = (
    PlateSheet(bar(0.0, 0.03, 0.035, 0.13), BLACK),
    PlateSheet(bar(0.0, -0.16, 0.035, 0.03), BLACK, False),
)
_ARROW = (
    PlateSheet(bar(0.0, -0.03, 0.035, 0.16), BLACK),
    PlateSheet(np.array([(-0.09, 0.10), (0.09, 0.10), (0.0, 0.24)]), BLACK, False),
    PlateSheet(bar(0.0, -0.06, 0.14, 0.03), BLACK, False),
)
_ENDED = (PlateSheet(_stroke(0.02, 0.235), BLACK),)


def _plain(width_m: float, height_m: float) -> SignPicture:
    plate = bar(0.0, 0.0, 0.5 * width_m, 0.5 * height_m)
    return SignPicture((PlateSheet(plate, _GREY), PlateSheet(plate * 0.92, WHITE)))


_GERMAN: dict[str, SignPicture] = {
    "101": _triangle(*_MARK),
    "205": _triangle(on_its_tip=True),
    "206": _stop(),
    "250": _round(RED, WHITE),
    "260": _round(RED, WHITE),
    "267": _round(RED, RED, PlateSheet(bar(0.0, 0.0, 0.21, 0.05), WHITE)),
    "276": _round(RED, WHITE, PlateSheet(bar(-0.09, 0.0, 0.05, 0.05), RED),
                  PlateSheet(bar(0.09, 0.0, 0.05, 0.05), BLACK, False)),
    "278": _round(WHITE, WHITE, *_ENDED),
    "282": _round(WHITE, WHITE, *_ENDED),
    "283": _round(RED, BLUE, PlateSheet(_stroke(0.235, 0.03), RED),
                  PlateSheet(_stroke(0.03, 0.235), RED, False)),
    "286": _round(RED, BLUE, PlateSheet(_stroke(0.235, 0.03), RED)),
    "301": _triangle(*_ARROW),
    "306": _priority(),
    "350": _crossing(),
}  # fmt: skip
_OTHERS = {"R1-1": "206", "R1-2": "205"}
"""Types of the United States' catalogue (MUTCD) by the German one whose picture is alike."""
_LIMIT = "274"
_PLAIN_M = (0.6, 0.6)
_OLD_SUBTYPE = 50


def picture_of(signal: RoadSignal) -> SignPicture:
    """The picture of a sign; a white plate of its size if its type is not known."""
    kind = _OTHERS.get(signal.type, signal.type.partition("-")[0].partition(".")[0])
    if kind == _LIMIT and (text := limit_text(signal)):
        return _speed_limit(text)
    if kind in _GERMAN:
        return _GERMAN[kind]
    if signal.width_m > 0.0 and signal.height_m > 0.0:
        return _plain(signal.width_m, signal.height_m)
    return _plain(*_PLAIN_M)


def limit_text(signal: RoadSignal) -> str:
    """The number on a speed limit: of its value, its text or its subtype; empty: none is known.

    Subtypes are the number itself (``274-70``) or, as in the catalogue of 1992, 50 and a tenth of
    it (``274-57``).
    """
    if signal.value is not None and 0.5 < signal.value < 999.5:
        value = signal.value * 3.6 if signal.unit == "m/s" else signal.value
        return f"{value:.0f}" if value < 999.5 else ""
    if digits := re.search(r"\d{1,3}", signal.text):
        return digits[0]
    subtype = signal.type.partition("-")[2] or signal.subtype
    if not re.fullmatch(r"\d{1,3}", subtype):
        return ""
    number = int(subtype)
    if _OLD_SUBTYPE < number <= 63 and number % 10:
        number = 10 * (number - _OLD_SUBTYPE)
    return str(number) if number else ""
