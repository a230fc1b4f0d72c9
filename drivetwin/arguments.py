"""Arguments of a run, declared once, and the request that the command line's code takes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from twin.base.errors import UsageError

if TYPE_CHECKING:
    from conductor.run.changes import CampaignChanges
    from conductor.run.requested import RunRequest

VIEWS = ("live", "none", "record", "record+live")
"""What may be shown of cases, and recorded."""


class RunArguments(TypedDict, total=False):
    """What a run may be given; what is left out is as `conductor run` has it."""

    axes: Mapping[str, Sequence[Any]]
    """Axes of the matrix, in place of the file's: ``{"weather": ["clear", "heavy_fog"]}``."""
    settings: Mapping[str, Any]
    """Keys of the campaign by their path, in place of the file's: ``{"camera.width": 320}``; a
    class as a value stands for its entry point, ``{"autonomy.stack": my_stack.Cautious}``."""
    out: str | Path
    """Campaign folder; default ``runs/CAMPAIGN``."""
    workers: int | str
    """Local workers; default one per core, at most 8. ``"cuda"``: one on every GPU."""
    slots: int
    """Cases together per worker; default 2 if each worker has four cases, on a GPU what fits."""
    device: str
    """``cpu`` or ``cuda:N``."""
    seed: int
    """In place of the campaign's."""
    case: str
    """Only this case."""
    cases: int
    """Only so many, the first."""
    rows: Sequence[str]
    """Only these rows of its rulebook."""
    quick: bool
    """Only the easiest and the hardest point of each row of its rulebook."""
    by_batch: bool
    """Its batches one after the other."""
    history: str | Path
    """Folder of an earlier run, whose longest cases begin first."""
    view: str
    """``record`` for :meth:`drivetwin.Run.frame`; else ``live``, ``none`` or ``record+live``."""
    record_drive: bool
    """Record what the stack sees and answers, without loss."""
    render: bool
    """False: no camera sees anything."""
    memory_gb: float
    """Most memory of a rig [GB]."""


def request_of(
    campaign: str | Path, arguments: Mapping[str, Any], *, searches: bool = False
) -> RunRequest:
    """The request that arguments of a run mean.

    Raises:
        UsageError: there is no such argument, or a value of another type; what only the campaign
            can tell is told later.
    """
    from conductor.run.requested import RunRequest
    from schemas.sections.view_mode import ViewMode
    from schemas.validation import suggest

    known = list(RunArguments.__annotations__)
    for name in arguments:
        if name not in known:
            raise UsageError(f"run: no argument '{name}'; {suggest(name, known)}")
    given = {name: value for name, value in arguments.items() if value is not None}
    view = given.pop("view", None)
    if view is not None and view not in VIEWS:
        raise UsageError(f"view: given {view!r}, allowed: {', '.join(VIEWS)}")
    rows = of_type("rows", given.pop("rows", ()), str | list | tuple)
    changes = changes_of(given.pop("axes", None), given.pop("settings", None))
    for name in ("out", "history"):
        if name in given:
            given[name] = Path(of_type(name, given[name], str | Path)).expanduser()
    if "workers" in given:
        given["workers"] = str(of_type("workers", given["workers"], int | str))
    for name, least in (("slots", 1), ("cases", 1), ("seed", 0)):
        if name in given and of_type(name, given[name], int) < least:
            raise UsageError(f"{name}: given {given[name]}, allowed: from {least}")
    for name in ("case", "device"):
        of_type(name, given.get(name, ""), str)
    for name in ("quick", "by_batch", "record_drive", "render"):
        of_type(name, given.get(name, False), bool)
    memory_gb = of_type("memory_gb", given.get("memory_gb", 1.0), int | float)
    if not 0.1 <= memory_gb <= 1e6:
        raise UsageError(f"memory_gb: given {memory_gb}, allowed: 0.1 to 1000000")
    return RunRequest(
        campaign=str(of_type("campaign", campaign, str | Path)),
        changes=changes,
        view=None if view is None else ViewMode(view),
        rows=rows if isinstance(rows, str) else ",".join(map(str, rows)),
        searches=searches,
        **given,
    )


def changes_of(
    axes: Mapping[str, Sequence[Any]] | None, settings: Mapping[str, Any] | None
) -> CampaignChanges:
    """Changes of a campaign; classes among the values become entry points.

    Raises:
        UsageError: one of them is no mapping by names, or a class lies in no module.
    """
    from conductor.run.changes import CampaignChanges

    for name, given in (("axes", axes), ("settings", settings)):
        if given is not None and not isinstance(given, Mapping):
            raise UsageError(f"{name}: expected a mapping, e.g. {{'weather': ['clear']}}")
        for key in given or ():
            of_type(f"key of {name}", key, str)
    return CampaignChanges(
        settings={path: entry_point(value) for path, value in (settings or {}).items()},
        axes=axes or {},
    )


def entry_point(value: Any) -> Any:
    """``module:Class`` of a class; other values as they are.

    Raises:
        UsageError: the class was made in a notebook's cell or a script, or in a function.
    """
    if not isinstance(value, type):
        return value
    if value.__module__ == "__main__" or not re.fullmatch(r"\w+", value.__qualname__):
        raise UsageError(
            f"{value.__qualname__}: a stack runs in a process of its own and is known by its file; "
            f"write the class into a module (in a notebook `%%writefile my_stack.py`) and give "
            f"'my_stack:{value.__name__}'"
        )
    return f"{value.__module__}:{value.__qualname__}"


def of_type(name: str, value: Any, allowed: Any) -> Any:
    """A value of a type that is allowed; True is no number here.

    Raises:
        UsageError: it is of another type.
    """
    if not isinstance(value, allowed) or (isinstance(value, bool) and allowed is not bool):
        types = [kind.__name__ for kind in getattr(allowed, "__args__", (allowed,))]
        raise UsageError(f"{name}: given {value!r}, allowed: {' or '.join(types)}")
    return value
