"""The options that ``render``, ``submit`` and ``shell`` have in common, declared once."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schemas.kinds.batch_system import AUTO, batch_systems
from twin.base.errors import UsageError

if TYPE_CHECKING:
    SchedulerName = str
else:
    SchedulerName = StrEnum(
        "SchedulerName", {name: name for name in (AUTO, *batch_systems().names())}
    )
    SchedulerName.__doc__ = "Names of batch systems, as the command line takes them."

_CONSTRAINTS = ", ".join(f"{kind.constraint} ({kind.title})" for kind in batch_systems().declared)


class ContainerRuntime(StrEnum):
    """Programs that enter an image; the values of :data:`hpc.software.container.Runtime`."""

    apptainer = "apptainer"
    charliecloud = "charliecloud"
    podman = "podman"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What the command line says of a job; what is left out comes from the site file."""

    time: Annotated[str, typer.Option(help="Longest duration of one start of the job, HH:MM.")]
    scheduler: Annotated[
        SchedulerName | None, typer.Option(help="Batch system; auto: the one that is here.")
    ] = None
    gpus: Annotated[int, typer.Option(help="GPUs; one worker on each.")] = 0
    workers: Annotated[int, typer.Option(help="Or: workers on the CPU.")] = 0
    nodes: Annotated[int | None, typer.Option(help="Nodes; default: the scheduler's choice.")] = (
        None
    )
    partition: Annotated[str, typer.Option(help="Partition (queue).")] = ""
    account: Annotated[str, typer.Option(help="Account to charge.")] = ""
    constraint: Annotated[str, typer.Option(help=f"Kind of node: {_CONSTRAINTS}.")] = ""
    out: Annotated[
        Path | None,
        typer.Option(help="Campaign folder that all nodes see; default runs/CAMPAIGN, here."),
    ] = None
    slots: Annotated[
        int | None,
        typer.Option(help="Cases together per worker; default: 1, on a GPU what its memory holds."),
    ] = None
    cpus_per_worker: Annotated[
        int | None, typer.Option(help="CPUs per worker; default 4 beside a GPU, else 1.")
    ] = None
    signal_lead: Annotated[
        int, typer.Option(help="Stop this long before the end of the time [s].")
    ] = 60
    restarts_max: Annotated[
        int, typer.Option(help="How often an unfinished job queues itself again.")
    ] = 20
    address: Annotated[
        str, typer.Option(help="Where the conductor listens; default: its node's address.")
    ] = ""
    interface: Annotated[
        str,
        typer.Option(help="Or: interface or network that nodes talk over, ib0 or 10.1.0.0/16."),
    ] = ""
    scratch: Annotated[
        str, typer.Option(help="Folder for temporary files on each node, e.g. $TMPDIR.")
    ] = ""
    directive: Annotated[
        list[str] | None,
        typer.Option(help="Further option of the scheduler, repeatable, e.g. --qos=long."),
    ] = None
    bin_folder: Annotated[
        Path | None,
        typer.Option(
            "--bin", help="Folder of `conductor` and `twin` on the nodes; default: this one's."
        ),
    ] = None
    container: Annotated[
        str, typer.Option(help="Image in which everything runs, see `hpc image build`.")
    ] = ""
    container_runtime: Annotated[
        ContainerRuntime, typer.Option(help="How the image is entered.")
    ] = ContainerRuntime.apptainer
    container_bind: Annotated[
        list[Path] | None,
        typer.Option(help="Further folder that is seen inside, repeatable, e.g. of data."),
    ] = None
    history: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN",
            help="Folder of an earlier run, which all nodes see: its longest cases begin first.",
        ),
    ] = None
    site: Annotated[
        Path | None,
        typer.Option(help="Site defaults; default ~/.config/drivetwin/site.yaml if it is there."),
    ] = None


def own_bin_folder() -> Path:
    """Where this Python environment keeps its commands."""
    folder = Path(sys.executable).parent
    missing = [name for name in ("conductor", "twin", "devkit") if not (folder / name).exists()]
    if missing:
        raise UsageError(
            f"{folder}: no command {' and '.join(missing)} there; say with --bin where they are"
        )
    return folder
