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
