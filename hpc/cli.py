"""The ``hpc`` command."""

from __future__ import annotations

import twin.fabric.start  # noqa: F401 - before anything that takes long to load

# isort: split
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from hpc.image_cli import add_commands
from twin.fabric.cli import make_app, run
from twin.fabric.errors import UsageError


class Scheduler(StrEnum):
    """Batch systems that a script can be written for."""

    slurm = "slurm"


app = make_app(
    "hpc",
    "Campaigns on clusters. `hpc render aeb-256 --gpus 4 --time 01:00 > job.sh` writes a job "
    "script to read, change and submit with `sbatch job.sh`.",
)


@app.command()
def render(
    campaign: Annotated[str, typer.Argument(help="Shipped campaign or path of a campaign file.")],
    time: Annotated[str, typer.Option(help="Longest duration of one start of the job, HH:MM.")],
    scheduler: Annotated[Scheduler, typer.Option(help="Batch system.")] = Scheduler.slurm,
    gpus: Annotated[int, typer.Option(help="GPUs; one worker on each.")] = 0,
    workers: Annotated[int, typer.Option(help="Or: workers on the CPU.")] = 0,
    nodes: Annotated[
        int | None, typer.Option(help="Nodes; default: the scheduler's choice.")
    ] = None,
    partition: Annotated[str, typer.Option(help="Partition (queue).")] = "",
    account: Annotated[str, typer.Option(help="Account to charge.")] = "",
    out: Annotated[
        Path | None,
        typer.Option(help="Campaign folder that all nodes see; default runs/CAMPAIGN, here."),
    ] = None,
    slots: Annotated[int, typer.Option(help="Cases together per worker.")] = 1,
    cpus_per_worker: Annotated[
        int | None, typer.Option(help="CPUs per worker; default 4 beside a GPU, else 1.")
    ] = None,
    signal_lead: Annotated[
        int, typer.Option(help="Stop this long before the end of the time [s].")
    ] = 60,
    restarts_max: Annotated[
        int, typer.Option(help="How often an unfinished job queues itself again.")
    ] = 20,
    address: Annotated[
        str,
        typer.Option(help="Where the conductor listens; default: its node's address in Slurm."),
    ] = "",
    bin_folder: Annotated[
        Path | None,
        typer.Option(
            "--bin", help="Folder of `conductor` and `twin` on the nodes; default: this one's."
        ),
    ] = None,
) -> None:
    """Print a job script that runs a campaign in one allocation.

    The job's exit code is the verdict. Before its time is over it queues itself again and goes on.
    """
    from hpc.campaigns import checked
    from hpc.request import JobRequest, parse_walltime
    from hpc.slurm import job_name
    from hpc.slurm import render as render_slurm

    walltime_min = parse_walltime(time)
    named = checked(campaign)
    folder = out or Path("runs") / job_name(named)
    request = JobRequest(
        campaign=named,
        out=str(folder.absolute()),
        folder=str(Path.cwd()),
        bin_folder=str(bin_folder.absolute() if bin_folder else _own_bin_folder()),
        walltime_min=walltime_min,
        gpus=gpus,
        workers=workers,
        nodes=nodes,
        partition=partition,
        account=account,
        slots=slots,
        cpus_per_worker=cpus_per_worker,
        signal_lead_s=signal_lead,
        restarts_max=restarts_max,
        address=address,
    )
    assert scheduler is Scheduler.slurm
    print(render_slurm(request), end="")


def _own_bin_folder() -> Path:
    """Where this Python environment keeps its commands."""
    folder = Path(sys.executable).parent
    missing = [name for name in ("conductor", "twin") if not (folder / name).exists()]
    if missing:
        raise UsageError(
            f"{folder}: no command {' and '.join(missing)} there; say with --bin where they are"
        )
    return folder


add_commands(app)


def main() -> None:
    """Entry point."""
    run(app, "hpc")
