"""The lights: which lamps burn, by ambient light and visibility, without flicker.

The table is the original's (AutoDRIVE), but driven by sensors where that one read the clock and the
name of the weather:

======  ==========================  =====
        lamps                       code
======  ==========================  =====
day     parking                     3
day     parking, fog (in fog)       9
night   high beam, parking          7
night   low beam, parking, fog      10
======  ==========================  =====

Low beam in fog because high beam lights up the fog instead of the road. Hazard indicators burn from
the AEB trigger on (there: from the collision on).

The published script means this table but lights for fog always: its condition, "not sunny or not
cloudy", holds in every weather.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta, Struct

from schemas.files.kpi import HEADLIGHTS, INDICATORS, headlight_code
from schemas.messages import Lights

INDICATORS_OFF, INDICATORS_HAZARD = INDICATORS.index("off"), INDICATORS.index("hazard")


class LightsSwitch(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the lights: two thresholds per quantity, between them nothing changes."""

    dark_below_lx: Annotated[float, Meta(ge=0, le=200_000)] = 1000.0
    """Illuminance below which it is night [lx], 0 to 200,000."""
    bright_above_lx: Annotated[float, Meta(ge=0, le=200_000)] = 2000.0
    """Illuminance above which it is day [lx], 0 to 200,000, not below ``dark_below_lx``."""
    fog_above_per_m: Annotated[float, Meta(ge=0, le=1)] = 0.006
    """There is fog above this extinction [1/m], 0 to 1; 0.006 is 650 m visibility (2 %).

    The sensor knows visibility, not its cause: rain or snow this dense counts as fog.
    """
    clear_below_per_m: Annotated[float, Meta(ge=0, le=1)] = 0.0045
    """There is none below this extinction [1/m], 0 to 1, not above ``fog_above_per_m``."""

    def __post_init__(self) -> None:
        if self.bright_above_lx < self.dark_below_lx:
            raise ValueError(
                f"bright_above_lx: given {self.bright_above_lx:g}, "
                f"allowed: at least dark_below_lx {self.dark_below_lx:g}"
            )
        if self.clear_below_per_m > self.fog_above_per_m:
            raise ValueError(
                f"clear_below_per_m: given {self.clear_below_per_m:g}, "
                f"allowed: at most fog_above_per_m {self.fog_above_per_m:g}"
            )


@dataclass(frozen=True, slots=True)
class LightSurroundings:
    """What the lights believe: the state that hysteresis needs."""

    dark: bool = False
    fog: bool = False


def sense(
    before: LightSurroundings, illuminance_lx: float, extinction_per_m: float, switch: LightsSwitch
) -> LightSurroundings:
    """Update the belief with one reading; on a threshold exactly, nothing changes."""
    dark, fog = before.dark, before.fog
    if illuminance_lx < switch.dark_below_lx:
        dark = True
    elif illuminance_lx > switch.bright_above_lx:
        dark = False
    if extinction_per_m > switch.fog_above_per_m:
        fog = True
    elif extinction_per_m < switch.clear_below_per_m:
        fog = False
    return LightSurroundings(dark, fog)


def choose(surroundings: LightSurroundings, aeb: bool) -> Lights:
    """The lamps for ``surroundings``, by the table above; hazard indicators with ``aeb``."""
    return Lights(
        low=surroundings.dark and surroundings.fog,
        high=surroundings.dark and not surroundings.fog,
        parking=True,
        fog=surroundings.fog,
        indicators=INDICATORS_HAZARD if aeb else INDICATORS_OFF,
    )


def code_of(lights: Lights) -> int:
    """AutoDRIVE's headlight code of what burns, 0 to 11; high beam wins over low beam."""
    return headlight_code(lights.low, lights.high, lights.parking, lights.fog)


def name_of(code: int) -> str:
    """The lamps of a headlight code in words: ``low beam, parking, fog`` for 10.

    Raises:
        ValueError: no such code.
    """
    return HEADLIGHTS[_known(code)][0]


def of_code(code: int, indicators: int = INDICATORS_OFF) -> Lights:
    """The lamps that AutoDRIVE's headlight code stands for; the inverse of :func:`code_of`.

    Raises:
        ValueError: no such code.
    """
    burning = HEADLIGHTS[_known(code)][1].split()
    return Lights(**dict.fromkeys(burning, True), indicators=indicators)


def _known(code: int) -> int:
    if not 0 <= code < len(HEADLIGHTS):
        raise ValueError(f"headlight code {code}: allowed: 0 to {len(HEADLIGHTS) - 1}")
    return code
