"""Changes that are asked for in a campaign: keys by their path, axes by their name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from schemas.files.yaml_file import YamlError, parse_yaml
from schemas.validation import Mistake
from twin.base.errors import UsageError


@dataclass(frozen=True, slots=True)
class CampaignChanges:
    """Values in place of those of a campaign file; what they may be, its schema says."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Path of a key, such as ``autonomy.stack`` -> its value, whole."""
    axes: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """Axis of the matrix -> its values."""
    typed: bool = False
    """Whether they were typed as options, ``--set`` and ``--axis``: mistakes name those."""

    def made_in(self, data: Any, shown: str) -> Any:
        """The content of the campaign that is ``shown``, with the changes.

        Raises:
            UsageError: a path leads through a value that has no keys, an axis has no list of
                values, or the campaign lists its cases and has no matrix.
        """
        if not isinstance(data, dict):
            return data  # checking it says what it is
        settings, axes = ("--set", "--axis") if self.typed else ("settings", "axes")
        for path, value in self.settings.items():
            data = _with(data, path, value, f"{settings}: '{path}'")
        if self.axes and data.get("cases") and not data.get("matrix"):
            raise UsageError(f"{axes}: {shown} lists its cases; give them other values there")
        for axis, values in self.axes.items():
            if isinstance(values, str) or not isinstance(values, Sequence) or not values:
                raise UsageError(f"{axes}: '{axis}' takes a list of values, e.g. [{values!r}]")
            # A matrix that is none is said where the file is checked.
            if isinstance(matrix := data.get("matrix") or {}, dict):
                data = {**data, "matrix": {**matrix, axis: list(values)}}
        return data

    def line(self, mistake: Mistake) -> str:
        """A mistake in one line if a change that was given made it; empty: it is the file's."""
        for axis in self.axes:
            key = mistake.path.partition("[")[0]
            if key == f"matrix.{axis}":  # or one of its values
                name = f"--axis {axis}" if self.typed else f"axes.{axis}"
                return Mistake("", mistake.message).line(name)
        for path in self.settings if self.typed else ():
            if mistake.path == path or mistake.path.startswith((f"{path}.", f"{path}[")):
                return Mistake("", mistake.message).line(f"--set {mistake.path}")
        return ""

    def refuse_twice(self, options: Mapping[str, bool]) -> None:
        """Refuse what an option of its own and a change would both set.

        Args:
            options: name of an option, which is that of a key or an axis, too -> whether it was
                given.

        Raises:
            UsageError: one is set twice.
        """
        for name, given in options.items():
            words = [f"--axis {name}"] if name in self.axes else []
            words += [f"--set {p}" for p in (name, f"matrix.{name}") if p in self.settings]
            if self.typed and given and words:
                raise UsageError(f"--{name} and {words[0]} say the same; give one of them")


NO_CHANGES = CampaignChanges()
"""The campaign as its file says."""


def typed_changes(axes: Sequence[str] | None, settings: Sequence[str] | None) -> CampaignChanges:
    """Changes as people type them; values are read as a campaign file's are.

    Args:
        axes: ``NAME=V1,V2`` each.
        settings: ``PATH=VALUE`` each.

    Raises:
        UsageError: one is not of this form, has no value, or is given twice.
    """
    named = {
        name: _value("--axis", name, f"[{text}]")
        for name, text in _pairs("--axis", axes or (), "NAME=V1,V2, e.g. weather=clear,heavy_fog")
    }
    set_ = {
        path: _value("--set", path, text)
        for path, text in _pairs("--set", settings or (), "PATH=VALUE, e.g. camera.width=320")
    }
    paths = [(path, f"--set {path}") for path in set_]
    _refuse_lost([*paths, *((f"matrix.{name}", f"--axis {name}") for name in named)])
    return CampaignChanges(set_, named, typed=True)


def _refuse_lost(changes: Sequence[tuple[str, str]]) -> None:
    """Refuse a change that a later one replaces; each is a path, and the option as typed."""
    for number, (path, after) in enumerate(changes):
        for lost, before in changes[:number]:
            if f"{lost}.".startswith(f"{path}."):
                raise UsageError(f"{before}: {after} replaces it; give one of them")


def _pairs(option: str, words: Sequence[str], form: str) -> Iterator[tuple[str, str]]:
    seen = set()
    for word in words:
        name, equals, text = word.partition("=")
        name = name.strip()
        if not (name and equals and text.strip()):
            raise UsageError(f"{option} {word[:80]!r}: expected {form}")
        if name in seen:
            raise UsageError(f"{option} {name}: is given twice; give it once")
        seen.add(name)
        yield name, text


def _value(option: str, name: str, text: str) -> Any:
    try:
        return parse_yaml(text, f"{option} {name}")
    except YamlError as error:
        raise UsageError(f"{error}; quote what YAML would take for something else") from None


def _with(data: dict[str, Any], path: str, value: Any, named: str) -> dict[str, Any]:
    """A mapping with a value at a path; the mappings on the way are copied. ``named``: the change,
    in an error."""
    key, _, rest = path.partition(".")
    if not key:
        raise UsageError(f"{named}: expected the path of a key, e.g. camera.width")
    if not rest:
        return {**data, key: value}
    inner = data.get(key)
    if not isinstance(inner, dict | None):
        raise UsageError(f"{named}: '{key}' is a value and has no keys; set it itself")
    return {**data, key: _with(inner or {}, rest, value, named)}
