"""Sites of a user: the clusters that ``--on`` names, in one YAML file.

``~/.config/drivetwin/sites.yaml`` (see :mod:`twin.base.own_folder`), or the file that
``--sites`` names::

    listen: tls/0.0.0.0:7447            # the conductor, on the host where `hpc submit` is typed
    sites:
      north:
        scheduler: slurm
        ssh: me@login.north.example     # left out: its commands are on this host
        folder: /home/me/drivetwin      # there; job scripts and keys lie in it
        bin: /home/me/drivetwin/.venv/bin
        workers: 8                      # of one allocation
        cost: 0.02                      # of a worker's hour
      pool:
        scheduler: kubernetes
        kubeconfig: /home/me/.kube/pool
        gpus: 4
        directives: [--image=registry.example/drivetwin:1]

The file says which programs are run, so it is believed only if it is the user's own.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from hpc.commands import Place
from hpc.site import BatchDefaults
from hpc.software.container import Runtime
from schemas.escape import escape
from schemas.files.yaml_file import YamlError, load_yaml
from schemas.kinds.batch_system import batch_systems
from schemas.validation import convert_all
from schemas.wire.site_name import SITE_PATTERN
from twin.base.errors import UsageError
from twin.base.own_folder import own_folder
from twin.stores.opening import checked_url

FILE_NAME = "sites.yaml"
SITES_MAX = 64
"""Most sites of a file."""
ALLOCATIONS_MAX = 1000
"""Most allocations of a site that may be there at once."""

_LOGIN = r"([A-Za-z0-9_][A-Za-z0-9_.-]{0,63}@)?[A-Za-z0-9][A-Za-z0-9.-]{0,252}"
_ENDPOINT = r"tls/(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9][A-Za-z0-9.-]{0,252}):[0-9]{1,5}"
_COUNT = Meta(ge=0, le=4096)


class SiteEntry(BatchDefaults, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One cluster; what is left out is as the command line says, or left to its scheduler."""

    scheduler: str
    """Batch system, e.g. ``slurm``."""
    ssh: Annotated[str, Meta(pattern=rf"^({_LOGIN})?\Z")] = ""
    """Login node, as for ``ssh``; empty: its commands are on this host."""
    reach: list[str] = []  # noqa: RUF012 - msgspec copies it
    """Or: words before one line of shell that is run there."""
    dials_out: bool = False
    """Nobody reaches it from here: ``hpc submit`` writes a key and says what to type there."""
    connect: Annotated[str, Meta(pattern=rf"^({_ENDPOINT})?\Z")] = ""
    """Endpoint by which its nodes reach the conductor, a relay say; empty: the conductor's own."""
    kubeconfig: str = ""
    """File that says which Kubernetes is meant."""
    folder: str = ""
    """Folder over there for scripts and keys, which its nodes see, absolute."""
    bin: str = ""
    """Folder of `conductor` and `twin` over there."""
    workers: Annotated[int, _COUNT] | None = None
    """Workers on the CPU of one allocation."""
    gpus: Annotated[int, _COUNT] | None = None
    """Or: GPUs of one allocation, one worker on each."""
    time: str = ""
    """Longest duration of an allocation, HH:MM."""
    slots: Annotated[int, Meta(ge=1, le=4096)] | None = None
    """Cases together per worker."""
    allocations: Annotated[int, Meta(ge=1, le=ALLOCATIONS_MAX)] = 8
    """Most allocations at once."""
    queued: Annotated[int, Meta(ge=1, le=ALLOCATIONS_MAX)] = 1
    """Most of them that may wait in its queue."""
    cost: Annotated[float, Meta(ge=0.0, le=1e6)] | None = None
    """Price of a worker's hour, in whatever the user counts; left out: unknown."""
    container: str = ""
    """Image over there, absolute."""
    container_runtime: Runtime = "apptainer"
    """Program that enters it."""


class SitesFile(Struct, frozen=True, forbid_unknown_fields=True):
    """Content of the file."""

    sites: Annotated[dict[str, SiteEntry], Meta(max_length=SITES_MAX)]
    listen: Annotated[str, Meta(pattern=rf"^{_ENDPOINT}\Z")] = "tls/0.0.0.0:0"
    """Where the conductor listens that ``hpc submit --on`` starts."""
    store: str = ""
    """Result store, as for ``conductor serve``; each run has its own folder below; empty: none."""


@dataclass(frozen=True, slots=True)
class NamedSite:
    """A site that the command line has named."""

    name: str
    scheduler: str
    entry: SiteEntry

    @property
    def place(self) -> Place:
        """Where its commands are run."""
        reach = tuple(self.entry.reach)
        if self.entry.ssh:
            reach = ("ssh", "-o", "BatchMode=yes", "--", self.entry.ssh)
        return Place(reach=reach, kubeconfig=self.entry.kubeconfig)


def load_sites(named: Path | None, environment: Mapping[str, str] = os.environ) -> SitesFile:
    """The file ``named``, else the user's own.

    Raises:
        UsageError: it is missing, wrong, or somebody else may write it; one line per mistake.
    """
    path = named or own_folder(environment) / FILE_NAME
    _check_own(path)
    try:
        data = load_yaml(path)
    except YamlError as error:
        raise UsageError(str(error)) from None
    found, mistakes = convert_all({} if data is None else data, SitesFile)
    if found is None:
        raise UsageError("\n".join(mistake.line(str(path)) for mistake in mistakes))
    _check_store(path, found.store)
    for name, entry in found.sites.items():
        _check_entry(f"{path}: sites.{escape(name, 80)}", name, entry)
    return found


def chosen_sites(words: list[str], file: SitesFile) -> list[NamedSite]:
    """The sites that ``--on`` names, in that order.

    Raises:
        UsageError: there is no such site, or it has another batch system.
    """
    chosen: dict[str, NamedSite] = {}
    short = {kind.short: kind.name for kind in batch_systems().declared if kind.short}
    for word in words:
        kind, colon, name = word.partition(":")
        kind = short.get(kind, kind)
        entry = file.sites.get(name)
        if not colon or kind not in batch_systems().names():
            kinds = ", ".join((*batch_systems().names(), *short))
            raise UsageError(f"--on {escape(word, 80)}: expected KIND:SITE with a KIND of {kinds}")
        if entry is None:
            known = ", ".join(file.sites) or "none"
            raise UsageError(f"--on {escape(word, 80)}: no site {name!r}; the file has {known}")
        if entry.scheduler != kind:
            raise UsageError(f"--on {word}: the file says that {name} has {entry.scheduler}")
        if name in chosen:
            raise UsageError(f"--on {word}: given twice")
        chosen[name] = NamedSite(name, kind, entry)
    return [*chosen.values()]


def _check_own(path: Path) -> None:
    try:
        status = path.stat()
    except OSError as error:
        raise UsageError(
            f"{path}: {error.strerror}; it says which sites there are, see docs/sites.md"
        ) from None
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"{path}: no regular file")
    if status.st_uid not in (os.geteuid(), 0) or status.st_mode & 0o022:
        raise UsageError(
            f"{path}: others may write it, and it says which programs are run as you; give a file "
            "of your own, and run `chmod go-w` on it"
        )


def _check_store(path: Path, store: str) -> None:
    if not store:
        return
    if "://" not in store or store.startswith("file:") or not store.isprintable():
        raise UsageError(
            f"{path}: store {escape(store, 80)}: expected a URL that every site reaches, e.g. "
            "s3://BUCKET/PREFIX"
        )
    try:
        checked_url(store)
    except UsageError as error:
        raise UsageError(f"{path}: {str(error).removeprefix('--')}") from None


def _check_entry(where: str, name: str, entry: SiteEntry) -> None:
    if not re.fullmatch(SITE_PATTERN, name):
        raise UsageError(f"{where}: a site's name is 1 to 32 letters, digits and -")
    if entry.scheduler not in batch_systems().names():
        allowed = ", ".join(batch_systems().names())
        raise UsageError(f"{where}.scheduler {entry.scheduler!r}: allowed are {allowed}")
    if entry.ssh and entry.reach:
        raise UsageError(f"{where}: give ssh or reach, not both")
    for key in ("folder", "bin", "container", "kubeconfig"):
        if (value := getattr(entry, key)) and not (value.startswith("/") and value.isprintable()):
            raise UsageError(f"{where}.{key} {value!r}: give an absolute path on one line")
    if (entry.ssh or entry.reach) and not (entry.folder and entry.bin):
        raise UsageError(
            f"{where}: reached over {'ssh' if entry.ssh else 'reach'}, so say its folder and its "
            "bin, as its own nodes see them"
        )
    if entry.workers and entry.gpus:
        raise UsageError(f"{where}: give workers or gpus, not both")
