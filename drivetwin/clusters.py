"""Campaigns on clusters."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivetwin.arguments import of_type
from hpc.options import ContainerRuntime, Options, SchedulerName
from hpc.requested import submit_campaign
from hpc.submit import SubmittedJob
from schemas.validation import suggest
from twin.base.errors import UsageError

NUMBERS = frozenset(
    {"gpus", "workers", "nodes", "slots", "cpus_per_worker", "signal_lead", "restarts_max"}
)
LISTS = frozenset({"container_bind", "directive"})
FOLDERS = frozenset({"out", "site", "bin_folder", "history"})
"""Options that are no words."""


def submitted(campaign: str | Path, time: str, options: Mapping[str, Any]) -> SubmittedJob:
    """Submit a job, see :func:`drivetwin.submit`.

    Raises:
        TwinError: it could not be submitted; nothing was.
    """
    known = [field.name for field in dataclasses.fields(Options) if field.name != "time"]
    for name in options:
        if name not in known:
            raise UsageError(f"submit: no option '{name}'; {suggest(name, known)}")
    of_type("campaign", campaign, str | Path)
    of_type("time", time, str)
    return submit_campaign(str(campaign), Options(time=time, **_read(options)))


def _read(options: Mapping[str, Any]) -> dict[str, Any]:
    """Values as the command line reads them."""
    values = {name: value for name, value in options.items() if value is not None}
    for name, value in values.items():
        if name in NUMBERS:
            if isinstance(value, bool) or not isinstance(value, int) or value < 0:
                raise UsageError(f"{name}: given {value!r}, allowed: a number from 0")
        elif name in LISTS:
            for each in of_type(name, value, list | tuple):
                of_type(name, each, str | Path)
        elif name not in FOLDERS:
            of_type(name, value, str)
    for name in FOLDERS & values.keys():
        values[name] = Path(of_type(name, values[name], str | Path)).expanduser()
    if "container_bind" in values:
        values["container_bind"] = [Path(path) for path in values["container_bind"]]
    for name, words in (("scheduler", SchedulerName), ("container_runtime", ContainerRuntime)):
        if name in values:
            allowed = [str(word) for word in typing.cast(Any, words)]
            if values[name] not in allowed:
                raise UsageError(
                    f"{name}: given {values[name]!r}; {suggest(values[name], allowed)}"
                )
            values[name] = words(values[name])
    return values
