"""Requests for jobs of workers at sites: what the file says of a site, and what the command line
says of all."""

from __future__ import annotations

import dataclasses
import hashlib
import socket
from dataclasses import dataclass, replace
from pathlib import Path

from hpc.campaigns import CampaignFacts
from hpc.options import Options, own_bin_folder
from hpc.request import JobRequest, parse_walltime
from hpc.script import job_name
from hpc.sites.file import NamedSite
from hpc.software.container import BIN_FOLDER
from twin.base.errors import UsageError
from twin.stores.folder_id import folder_id

FOLDER_NAME = "sites"
"""Folder in the run folder for what sites without one of their own need."""
JOIN_KEY = "worker.key"
"""Name of the key beside a job script."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonOptions:
    """What the command line says of sites whose entry does not."""

    time: str = ""
    workers: int = 0
    gpus: int = 0
    slots: int | None = None
    store: str = ""
    """Result store of the run, of the sites file; empty: none."""


def request_of(
    site: NamedSite,
    allocation: str,
    *,
    campaign: str,
    out: Path,
    connect: str,
    common: CommonOptions,
    run: str = "",
) -> JobRequest:
    """What is asked of a site for one allocation.

    Args:
        site: the site.
        allocation: name of the allocation.
        campaign: shipped name, or path of the campaign file.
        out: run folder on this host.
        connect: endpoint by which workers of the site reach the conductor.
        common: what the command line says.
        run: id of the run, which a folder of the same name has no second time.

    Raises:
        UsageError: a value cannot be used.
    """
    entry = site.entry
    where = f"site {site.name}"
    if not (walltime := entry.time or common.time):
        raise UsageError(f"{where}: --time HH:MM is missing: how long may an allocation take?")
    said = entry.workers is not None or entry.gpus is not None
    folder = f"{remote_folder(entry.folder, out, run) if entry.folder else out / FOLDER_NAME}"
    own = f"{folder}/{allocation}"
    bin_folder = BIN_FOLDER if entry.container else entry.bin or str(own_bin_folder())
    try:
        return JobRequest(
            campaign=campaign,
            out=own,
            folder=own,
            bin_folder=bin_folder,
            walltime_min=parse_walltime(walltime),
            gpus=(entry.gpus or 0) if said else common.gpus,
            workers=(entry.workers or 0) if said else common.workers,
            partition=entry.partition,
            account=entry.account,
            constraint=entry.constraint,
            slots=entry.slots or common.slots,
            cpus_per_worker=entry.cpus_per_worker,
            modules=tuple(entry.modules),
            scratch=entry.scratch,
            directives=tuple(entry.directives),
            container=entry.container,
            container_runtime=entry.container_runtime,
            join=f"{own}/{JOIN_KEY}",
            connect=connect,
            store=common.store,
            site=site.name,
            allocation=allocation,
            run=run,
        )
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None


_OF_ALL_SITES = ("time", "workers", "gpus", "slots", "out", "history")
"""Options of a job that mean something with ``--on``: :class:`CommonOptions`, the run folder, and
the earlier run for the conductor, which is here."""


def refuse_of_one_site(options: Options) -> None:
    """Options that belong into the sites file.

    Raises:
        UsageError: one was given with ``--on``.
    """
    for field in dataclasses.fields(options):
        if field.name not in _OF_ALL_SITES and getattr(options, field.name) != field.default:
            option = field.name.removesuffix("_folder").replace("_", "-")
            raise UsageError(
                f"--{option}: differs from site to site, so with --on it belongs into the sites "
                "file, or has no meaning"
            )


def remote_folder(folder: str, out: Path, run: str) -> str:
    """Folder of a run at a site: other runs, also of other hosts, and later ones in the same folder
    have others. What a site keeps of a submission is an answer for this run alone."""
    mark = hashlib.sha256(f"{socket.gethostname()}:{out}:{run}".encode()).hexdigest()[:8]
    return f"{folder.rstrip('/')}/{job_name(out.name)}-{mark}"


def store_of(store: str, out: Path, mark: str) -> str:
    """Result store of a run below the one of the sites file: a store has one run; empty: none."""
    return f"{store.rstrip('/')}/{job_name(out.name)}-{mark}" if store else ""


def mark_of(out: Path) -> str:
    """What tells the store of this run folder from others: the beginning of the name by which a
    conductor claims a store for the folder.

    Raises:
        InfrastructureError: the folder cannot be read or written.
        UsageError: the file of that name is damaged.
    """
    return folder_id(out, "--out")[:8]


def with_store(common: CommonOptions, store: str, out: Path) -> CommonOptions:
    """``common`` with the run's own store below that of the sites file; empty: there is none."""
    return replace(common, store=store_of(store, out, mark_of(out))) if store else common


def check_campaign(facts: CampaignFacts, store: str = "") -> None:
    """What workers of other sites cannot have, without a result store (empty) or with one.

    Raises:
        UsageError: the campaign needs it.
    """
    if facts.remote_stacks:
        raise UsageError(
            "autonomy.placement: node: stacks on other nodes are announced in a folder that other "
            "sites do not see; take it out of the campaign"
        )
    if facts.drive_records:
        raise UsageError(
            "recording.drive: workers of other sites share no disk with the conductor, and no "
            "store has such records, so they would be lost; take it out of the campaign"
        )
    if facts.records and not store:
        raise UsageError(
            "recordings (view: record): workers of other sites share no disk with the conductor, "
            "so they would be lost; name a store in the sites file (store: s3://BUCKET/PREFIX), or "
            "take them out of the campaign"
        )
    if facts.files:
        raise UsageError(
            f"{facts.name}: names {', '.join(facts.files[:3])}, which other sites do not see; put "
            "them into a package that is installed at every site"
        )
