"""What NumPy prepares on the host, whose sines differ between instruction sets."""

from __future__ import annotations

from typing import Any


def tables(found: Any) -> None:
    """Worlds, skies, lenses, returns of rain and fog, storyboards."""
