"""Words for the state of a traffic signal, as far as they say which of its lamps are on."""

from __future__ import annotations

import re

RED, AMBER, GREEN = 1, 2, 4
"""Bits of the lamps of a traffic light."""
_WORDS = {
    "red": RED,
    "stop": RED,
    "amber": AMBER,
    "yellow": AMBER,
    "orange": AMBER,
    "attention": AMBER,
    "green": GREEN,
    "go": GREEN,
}
_SWITCHES = {"on": 1, "flashing": 1, "off": 0}
_LENSES = (RED, AMBER, GREEN)


def lamps_of_state(word: str) -> int | None:
    """Bits of the lamps that are on in a state: colours (``red``, ``red_amber``), or a switch for
    each lamp from red to green (``on;off;off``); ``off`` and an empty word: none.

    Returns:
        None: the word says nothing of lamps.
    """
    parts = re.findall("[a-z]+", word.lower())
    if not parts or parts == ["off"]:
        return 0
    if all(part in _SWITCHES for part in parts):
        if len(parts) > len(_LENSES):
            return None
        return sum(lens * _SWITCHES[part] for lens, part in zip(_LENSES, parts, strict=False))
    if any(part not in _WORDS for part in parts):
        return None
    lamps = 0
    for part in parts:
        lamps |= _WORDS[part]
    return lamps
