"""Changes that a program asks for in a campaign: keys by their path, axes by their name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from schemas.validation import Mistake
from twin.base.errors import UsageError


@dataclass(frozen=True, slots=True)
class CampaignChanges:
    """Values in place of those of a campaign file; what they may be, its schema says."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Path of a key, such as ``autonomy.stack`` -> its value, whole."""
    axes: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """Axis of the matrix -> its values."""

    def made_in(self, data: Any, shown: str) -> Any:
        """The content of the campaign that is ``shown``, with the changes.

        Raises:
            UsageError: a path leads through a value that has no keys, an axis has no list of
                values, or the campaign lists its cases and has no matrix.
        """
        if not isinstance(data, dict):
            return data  # checking it says what it is
        for path, value in self.settings.items():
            data = _with(data, path, value)
        if self.axes and data.get("cases") and not data.get("matrix"):
            raise UsageError(f"axes: {shown} lists its cases; give them other values there")
        for axis, values in self.axes.items():
            if isinstance(values, str) or not isinstance(values, Sequence) or not values:
                raise UsageError(f"axes: '{axis}' takes a list of values, e.g. [{values!r}]")
            # A matrix that is none is said where the file is checked.
            if isinstance(matrix := data.get("matrix") or {}, dict):
                data = {**data, "matrix": {**matrix, axis: list(values)}}
        return data

    def line(self, mistake: Mistake) -> str:
        """A mistake in one line if an axis that was given made it; empty: it is the file's."""
        for axis in self.axes:
            if mistake.path == f"matrix.{axis}":
                return Mistake("", mistake.message).line(f"axes.{axis}")
        return ""


NO_CHANGES = CampaignChanges()
"""The campaign as its file says."""


def _with(data: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """A mapping with a value at a path; the mappings on the way are copied."""
    key, _, rest = path.partition(".")
    if not key:
        raise UsageError(f"settings: '{path}': expected the path of a key, e.g. camera.width")
    if not rest:
        return {**data, key: value}
    inner = data.get(key)
    if not isinstance(inner, dict | None):
        raise UsageError(f"settings: '{path}': '{key}' is a value and has no keys; set it itself")
    return {**data, key: _with(inner or {}, rest, value)}
