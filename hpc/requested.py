"""From what is asked of a job to its request: for `hpc submit`, and for programs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from hpc.backends import scheduler
from hpc.campaigns import CampaignFacts, checked
from hpc.options import Options, own_bin_folder
from hpc.request import JobRequest, parse_walltime
from hpc.script import job_name
from hpc.site import Site, load_site
from hpc.software.container import BIN_FOLDER
from hpc.submit import SubmittedJob, submit
from twin.base.errors import UsageError
from twin.base.own_folder import own_folder
from twin.fabric.discovery import OUTCOMES_NAME


def submit_campaign(campaign: str, options: Options) -> SubmittedJob:
    """Check a campaign and what is asked for, and submit a job that runs it.

    Raises:
        TwinError: it could not be submitted; nothing was.
    """
    site = load_site(options.site)
    system = scheduler(scheduler_name(options, site))
    facts, request = checked_request(campaign, options, site)
    return submit(request, system, facts.deadline_s)


def scheduler_name(options: Options, site: Site) -> str:
    """Name of the batch system that is asked for, or that the site has."""
    return str(options.scheduler or site.scheduler)


def checked_request(
    campaign: str, options: Options, site: Site
) -> tuple[CampaignFacts, JobRequest]:
    """What a job has to know of a campaign, and the request of a job that runs it.

    Raises:
        TwinError: one of them is not valid.
    """
    facts = checked(campaign)
    request = request_of(campaign, options, site, remote_stacks=facts.remote_stacks)
    return facts, dataclasses.replace(
        request,
        campaign=facts.name,
        remote_commands=facts.commands,
        records=facts.records,
        drive_records=facts.drive_records,
        own_files=facts.files,
        own_paths=(*request.own_paths, *facts.paths),
    )


def request_of(campaign: str, options: Options, site: Site, *, remote_stacks: bool) -> JobRequest:
    """The request of a job, as far as it follows from what is asked and from the site's file.

    Args:
        campaign: its name, which the run folder is called by unless ``options.out`` names another.
        options: what is asked for.
        site: defaults of this cluster.
        remote_stacks: simulators and stacks run on different nodes.

    Raises:
        UsageError: a value cannot be used.
    """
    folder = options.out or Path("runs") / job_name(campaign)
    bin_folder = options.bin_folder.absolute() if options.bin_folder else None
    if bin_folder is None:
        bin_folder = Path(BIN_FOLDER) if options.container else own_bin_folder()
    return JobRequest(
        campaign=campaign,
        out=str(folder.absolute()),
        folder=str(Path.cwd()),
        bin_folder=str(bin_folder),
        walltime_min=parse_walltime(options.time),
        gpus=options.gpus,
        workers=options.workers,
        nodes=options.nodes,
        partition=options.partition or site.partition,
        account=options.account or site.account,
        constraint=options.constraint or site.constraint,
        slots=options.slots,
        cpus_per_worker=options.cpus_per_worker
        if options.cpus_per_worker is not None
        else site.cpus_per_worker,
        signal_lead_s=options.signal_lead,
        restarts_max=options.restarts_max,
        address=options.address,
        interface=options.interface or ("" if options.address else site.interface),
        modules=tuple(site.modules),
        scratch=options.scratch or site.scratch,
        directives=(*site.directives, *(options.directive or ())),
        container=_image(options),
        container_runtime=options.container_runtime.value,
        container_binds=tuple(str(path.absolute()) for path in options.container_bind or ()),
        history=earlier_run(options.history),
        home=str(own_folder()),
        own_paths=tuple(
            str(path.absolute())
            for path in (options.bin_folder, options.history)
            if path is not None
        ),
        remote_stacks=remote_stacks,
    )


def earlier_run(folder: Path | None) -> str:
    """Absolute path of an earlier run's folder; empty: none is given.

    Raises:
        UsageError: no campaign was run there.
    """
    if folder is None:
        return ""
    if not (folder / OUTCOMES_NAME).is_file():
        raise UsageError(
            f"--history {folder}: no {OUTCOMES_NAME} there; give the folder of an earlier run"
        )
    return str(folder.absolute())


def _image(options: Options) -> str:
    """A path as the nodes see it; podman also takes names such as ``org/name:1``."""
    image = options.container
    if not image or (options.container_runtime == "podman" and image[0] not in "/."):
        return image
    return str(Path(image).absolute())
