"""Defaults of a site, in one YAML file; options on the command line win.

``~/.config/drivetwin/site.yaml`` (see :mod:`twin.base.own_folder`), or the file that
``--site`` names::

    scheduler: slurm
    partition: gpu
    account: proj-123
    modules: [cuda/12.4]
    scratch: /local/scratch
    directives: ["--qos=long"]
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from schemas.files.yaml_file import YamlError, load_yaml
from schemas.kinds.batch_system import AUTO, SchedulerChoice
from schemas.validation import convert_all
from twin.base.errors import UsageError
from twin.base.own_folder import own_folder


class BatchDefaults(Struct, frozen=True, forbid_unknown_fields=True):
    """What stays the same for every job of one cluster; what is left out is left to its scheduler.

    A site file (:class:`Site`) says it of the cluster that one is logged in to, an entry of a sites
    file (:class:`hpc.sites.file.SiteEntry`) of one among several.
    """

    partition: str = ""
    """Partition or queue."""
    account: str = ""
    """Account to charge."""
    constraint: str = ""
    """Kind of node; see :class:`hpc.request.JobRequest`."""
    modules: list[str] = []
    """What ``module load`` loads on every node."""
    scratch: str = ""
    """Folder for temporary files on each node, e.g. ``/local/scratch`` or ``$TMPDIR``."""
    cpus_per_worker: Annotated[int, Meta(ge=1, le=1024)] | None = None
    """CPUs of one worker, 1-1024; default: 4 beside a GPU, else 1."""
    directives: list[str] = []
    """Further options of the scheduler, one per line of the script."""


class Site(BatchDefaults, frozen=True, forbid_unknown_fields=True):
    """One site file."""

    scheduler: SchedulerChoice = AUTO
    """Batch system; ``auto``: the one whose commands are there."""
    interface: str = ""
    """Network interface, network or address over which nodes talk."""


def load_site(named: Path | None, environment: Mapping[str, str] = os.environ) -> Site:
    """The site's defaults: of the file ``named``, else of the user's file if there is one.

    Raises:
        UsageError: the file is missing or wrong; one line per mistake.
    """
    path = named or usual_path(environment)
    if named is None and not path.exists():
        return Site()
    try:
        data = load_yaml(path)
    except YamlError as error:
        raise UsageError(str(error)) from None
    site, mistakes = convert_all({} if data is None else data, Site)
    if site is None:
        raise UsageError("\n".join(mistake.line(str(path)) for mistake in mistakes))
    return site


def usual_path(environment: Mapping[str, str] = os.environ) -> Path:
    """Path at which the user's file is looked for."""
    return own_folder(environment) / "site.yaml"
