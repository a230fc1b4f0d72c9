"""Campaigns from Python: run them, read what they came to, compare, search, submit.

::

    import drivetwin

    run = drivetwin.run("aeb-demo", axes={"weather": ["clear"]})
    print(run)
    run.cases().to_pandas()

It is the same code that the command line calls, with the same results to the last bit; the page
docs/python.md of the project explains it. Importing this package loads no simulator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from conductor.run.listener import RunProgress
from drivetwin.arguments import RunArguments, request_of
from drivetwin.finished import Run, RunReport, SearchRun, opened
from drivetwin.shipped import CheckedCampaign, ShippedCampaign, checked, shipped
from drivetwin.started import EventLine, RunEvent, StartedRun
from twin.base.errors import InfrastructureError, TwinError, UnfinishedError, UsageError

if TYPE_CHECKING:
    from drivetwin.changed import RunComparison
    from hpc.submit import SubmittedJob

__all__ = [
    "CheckedCampaign",
    "EventLine",
    "InfrastructureError",
    "Run",
    "RunArguments",
    "RunEvent",
    "RunProgress",
    "RunReport",
    "SearchRun",
    "ShippedCampaign",
    "StartedRun",
    "TwinError",
    "UnfinishedError",
    "UsageError",
    "arun",
    "campaigns",
    "compare",
    "open",
    "run",
    "search",
    "start",
    "submit",
    "validate",
]


def run(campaign: str | Path, *, progress: bool = True, **arguments: Unpack[RunArguments]) -> Run:
    """Run a campaign to its end on this machine, as `conductor run` does.

    The same call again goes on where it stopped: after Ctrl-C, in a notebook *Interrupt*, and after
    a crash. A case that does not pass is no error: it stands in :meth:`Run.cases`.

    Args:
        campaign: shipped name (:func:`campaigns`) or path of a campaign file.
        progress: show a bar in a terminal and in a notebook, lines elsewhere.
        arguments: see :class:`RunArguments`.

    Raises:
        UsageError: it cannot be run as asked; a line per mistake, before any case runs.
        InfrastructureError: disk, network or processes let us down; the same call goes on.
        UnfinishedError: its conductor was stopped; the same call goes on.
        KeyboardInterrupt: it was interrupted; workers have ended, the same call goes on.
    """
    return start(campaign, **arguments).wait(progress=progress)


async def arun(campaign: str | Path, **arguments: Unpack[RunArguments]) -> Run:
    """Run a campaign like :func:`run` while an event loop goes on; shows nothing.

    Cancelling the task stops the run first; the same call goes on.
    """
    return await start(campaign, **arguments)


def start(campaign: str | Path, **arguments: Unpack[RunArguments]) -> StartedRun:
    """Start a campaign in the background; takes what :func:`run` takes.

    One runs in a process at a time. Mistakes are raised by :meth:`StartedRun.wait`.

    Raises:
        UsageError: another one runs in this process, or an argument is none.
    """
    return StartedRun(request_of(campaign, arguments))


def search(
    campaign: str | Path, *, progress: bool = True, **arguments: Unpack[RunArguments]
) -> SearchRun:
    """Run a search: a campaign with a section `search`.

    ``settings={"search.budget.cases": 40}`` searches with another budget.

    Raises:
        UsageError: it is no search, or what :func:`run` says.
    """
    found = StartedRun(request_of(campaign, arguments, searches=True)).wait(progress=progress)
    return SearchRun(found.folder)


def open(place: str | Path, out: str | Path | None = None) -> Run:  # noqa: A001 - as in `drivetwin.open`
    """Open the folder of a run, or a run in a result store, also while it runs.

    Args:
        place: campaign folder, or the URL of a store such as ``s3://bucket/prefix``; of a store,
            only what reports read is fetched.
        out: folder for what is fetched; default ``runs/CAMPAIGN``.

    Raises:
        UsageError: there is no run.
        InfrastructureError: its files are damaged, or the store does not answer.
    """
    return opened(place, out)


def compare(before: Run | str | Path, after: Run | str | Path) -> RunComparison:
    """What changed between two runs of the same cases, as `conductor compare` says it.

    Raises:
        UsageError: one is no run, or they cannot be compared.
        UnfinishedError: cases of one have not ended.
        InfrastructureError: files are damaged.
    """
    from drivetwin.changed import compared

    return compared(before, after)


def submit(campaign: str | Path, *, time: str, **options: Any) -> SubmittedJob:
    """Submit a campaign to a cluster, as `hpc submit` does; read its results with :func:`open`.

    Args:
        campaign: shipped name or path of a campaign file.
        time: longest duration of one start of the job, ``HH:MM``.
        options: further options of `hpc submit` by their names with ``_``, such as ``gpus=4``,
            ``scheduler="slurm"``, ``out="runs/night"``.

    Raises:
        UsageError: there is no such option, or it cannot be submitted; nothing was.
        InfrastructureError: the scheduler does not answer; nothing was submitted.
    """
    from drivetwin.clusters import submitted

    return submitted(campaign, time, options)


def campaigns() -> list[ShippedCampaign]:
    """The campaigns that come with the package, by name."""
    return shipped()


def validate(
    campaign: str | Path,
    *,
    axes: Mapping[str, Sequence[Any]] | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
) -> CheckedCampaign:
    """Check a campaign and list its cases; nothing of it is run.

    Raises:
        UsageError: it is not valid; a line per mistake.
    """
    return checked(request_of(campaign, {"axes": axes, "settings": settings, "seed": seed}))
