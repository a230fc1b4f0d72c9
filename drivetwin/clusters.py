"""Campaigns on clusters."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hpc.options import ContainerRuntime, Options, SchedulerName
from hpc.requested import submit_campaign
from hpc.submit import SubmittedJob
from schemas.validation import suggest
from twin.base.errors import UsageError


def submitted(campaign: str | Path, time: str, options: Mapping[str, Any]) -> SubmittedJob:
    """Submit a job, see :func:`drivetwin.submit`.

    Raises:
        TwinError: it could not be submitted; nothing was.
    """
    known = [field.name for field in dataclasses.fields(Options) if field.name != "time"]
    for name in options:
        if name not in known:
            raise UsageError(f"submit: no option '{name}'; {suggest(name, known)}")
    return submit_campaign(str(campaign), Options(time=time, **_read(options)))


def _read(options: Mapping[str, Any]) -> dict[str, Any]:
    """Values as the command line reads them."""
    values = {name: value for name, value in options.items() if value is not None}
    for name in ("out", "site", "bin_folder"):
        if name in values:
            values[name] = Path(values[name])
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
    for name in ("gpus", "workers", "nodes", "slots", "cpus_per_worker"):
        if name in values and (not isinstance(values[name], int) or values[name] < 0):
            raise UsageError(f"{name}: given {values[name]!r}, allowed: a number from 0")
    return values
