"""Surface materials: integers carried by every face of the world mesh."""

from __future__ import annotations

PLAIN = 0
"""A matt colour with a little grain."""
ASPHALT = 1
"""Road surface: grain, patches, gets wet and snowed over."""
PAVING = 2
"""Sidewalk slabs with joints."""
PAINT = 3
"""Road markings; worn in places. Materials from ASPHALT to PAINT are ground."""
FACADE = 4
"""Wall with a grid of windows; the tag chooses the grid and which windows are lit."""
SHOPFRONT = 5
"""Ground floor with large panes, lit in the evening; the tag chooses the grid."""
FOLIAGE = 6
"""Leaves."""
CAR_PAINT = 7
"""Lacquer that mirrors the sky."""
GLASS = 8
"""Dark glass that mirrors the sky."""
STREET_LAMP = 9
"""Luminaire of a street lamp."""
HAZARD = 10
"""Amber lamp that blinks."""
REFLECTOR = 11
"""Red lens or foil that returns the light of the ego's headlamps."""
WINDOW = 12
"""One pane of a building; the tag chooses its curtain and whether it is lit in the evening."""
BRICK = 13
"""Masonry with courses of bricks; the tag chooses their shades."""
PLASTER = 14
"""A plain rendered or panelled wall with stains; the tag chooses them."""
SIGN = 15
"""Retroreflective sheeting of a traffic sign, in the face's colour."""
SIGNAL = 16
"""Lens of a traffic light that is on, in the face's colour."""
GRASS = 17
"""Lawn and open ground."""
TAIL_LAMP = 18
"""Red lens at the rear of a vehicle in traffic: tail and brake lamp."""
HEAD_LAMP = 19
"""Clear lens at the front of a vehicle in traffic."""
VEHICLE_LAMP = 20
"""Lens of a movable object in the face's colour; the tag is the :class:`VehicleLamp` it is."""
SIGNAL_LAMP = 21
"""Lens of a traffic light in the face's colour, lit in slots where it is on; the tag is 8 times the
index of the signal in the world plus the number of the lamp: 0 red, 1 amber, 2 green."""

WALLS = (FACADE, SHOPFRONT, BRICK, PLASTER)
"""Materials with a pattern along the wall."""

NAMES = {
    "plain": PLAIN,
    "asphalt": ASPHALT,
    "paving": PAVING,
    "paint": PAINT,
    "facade": FACADE,
    "shopfront": SHOPFRONT,
    "foliage": FOLIAGE,
    "car_paint": CAR_PAINT,
    "glass": GLASS,
    "brick": BRICK,
    "plaster": PLASTER,
    "sign": SIGN,
    "grass": GRASS,
}
"""Materials that scene files may name."""
