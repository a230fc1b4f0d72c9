"""The ``hpc`` command."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load

# isort: split
import dataclasses
import json
import re
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hpc.options import Options, SchedulerName
from hpc.sites.cli import OnOption, SitesOption, run_cancel, run_status, scale
from hpc.software.cli import add_commands
from schemas.kinds.batch_system import AUTO, batch_systems
from twin.base.cli import Output, OutputOption, make_app
from twin.base.command import run
from twin.base.errors import (
    EXIT_FAILED,
    EXIT_INFRASTRUCTURE,
    EXIT_PASS,
    EXIT_UNFINISHED,
    UsageError,
)
from twin.base.option_record import with_options

if TYPE_CHECKING:
    from hpc.scheduler import Scheduler

app = make_app(
    "hpc",
    "Campaigns on clusters. `hpc doctor` says what is here, `hpc submit aeb-256 --gpus 4 --time "
    "01:00` writes a job script, checks and submits it; `hpc render` only prints it.",
)

Campaign = Annotated[str, typer.Argument(help="Shipped campaign or path of a campaign file.")]
Job = Annotated[str, typer.Argument(help="Run folder, e.g. runs/aeb-256, or a job's id.")]
Which = Annotated[SchedulerName, typer.Option("--scheduler", help="Batch system of a job's id.")]


_AUTO = SchedulerName(AUTO)
_WORDLESS = {"gone": "not known any more; see its log", "unknown": "nothing is said of it"}
"""Said of jobs for which the batch system has no word, by their states."""
_OPENS = ", ".join(f"`{kind.opens}`" for kind in batch_systems().declared if kind.opens)


@app.command()
@with_options
def render(
    campaign: Campaign,
    array: Annotated[
        bool,
        typer.Option("--array", help="For comparison: a job array with one case per index."),
    ] = False,
    into: Annotated[
        Path | None,
        typer.Option(help="Folder to write instead, where a batch system takes several files."),
    ] = None,
    helm: Annotated[
        Path | None, typer.Option(help="Or: folder to write a Helm chart into (Kubernetes).")
    ] = None,
    *,
    options: Options,
) -> None:
    """Print a job script that runs a campaign in one allocation.

    The job's exit code is the verdict. Before its time is over it queues itself again and goes on.
    """
    from hpc.backends import backend
    from hpc.requested import checked_request, scheduler_name
    from hpc.site import load_site

    site = load_site(options.site)
    system = backend(scheduler_name(options, site))
    facts, request = checked_request(campaign, options, site)
    if helm is not None and (into is not None or array):
        raise UsageError("--helm: writes a chart and nothing else; leave --into and --array away")
    if array and options.history is not None:
        raise UsageError(
            "--history: an array has no conductor that orders its cases; leave it away"
        )
    if into is not None or helm is not None:
        from hpc.submit import write_chart, write_files

        if helm is not None:
            paths = write_chart(system, request, helm)
        else:
            assert into is not None
            paths = write_files(system, request, into, array=array)
        print("\n".join(map(str, paths)))
        return
    text = system.render_array(request, facts.cases) if array else system.render(request)
    print(text, end="")


@app.command()
@with_options
def submit(
    campaign: Campaign,
    on: OnOption = None,
    sites: SitesOption = None,
    output: OutputOption = Output.human,
    *,
    options: Options,
) -> None:
    """Write a job script into the run folder, check it, submit it, and say what to do next.

    Whatever is wrong is said in one line, and then nothing was submitted. The same command again
    goes on with a campaign that has stopped.

    With --on the conductor runs here, and each site is asked for workers that join it.
    """
    if on:
        raise typer.Exit(_submit_on(campaign, on, sites, options))
    from hpc.requested import submit_campaign

    done = submit_campaign(campaign, options)
    places = {"folder": shlex.quote(_short(done.out)), "log": shlex.quote(_short(done.log))}
    kind = batch_systems().find(done.scheduler)
    commands = {word: command.format(**places) for word, command in kind.afterwards}
    if output is Output.json:
        print(json.dumps(dataclasses.asdict(done) | {"commands": commands}))
        return
    print(f"submitted {done.scheduler} job {done.job}; its script is {_short(done.script)}")
    for name, command in commands.items():
        print(f"  {name:7} {command}")


def _submit_on(campaign: str, on: list[str], sites: Path | None, options: Options) -> int:
    from hpc.campaigns import checked
    from hpc.requested import earlier_run
    from hpc.script import job_name
    from hpc.sites.command import submit_on
    from hpc.sites.file import chosen_sites, load_sites
    from hpc.sites.requests import CommonOptions, refuse_of_one_site

    refuse_of_one_site(options)
    file = load_sites(sites)
    chosen = chosen_sites(on, file)
    facts = checked(campaign)
    return submit_on(
        facts,
        chosen,
        out=(options.out or Path("runs") / job_name(campaign)).absolute(),
        file=file,
        common=CommonOptions(
            time=options.time, workers=options.workers, gpus=options.gpus, slots=options.slots
        ),
        history=earlier_run(options.history),
        say=partial(print, flush=True),
    )


@app.command()
def status(
    job: Job,
    which: Which = _AUTO,
    sites: SitesOption = None,
    output: OutputOption = Output.human,
) -> None:
    """Say how a job stands in the queue; what its cases do, `conductor status` tells."""
    if run_status(Path(job), sites, as_json=output is Output.json):
        return
    system, number = _job(job, which)
    job_status = system.status(number)
    if output is Output.json:
        print(
            json.dumps({"scheduler": system.name, "job": number, **dataclasses.asdict(job_status)})
        )
        return
    parts = [
        job_status.native or _WORDLESS.get(job_status.state, ""),
        "which is no known state; ask again" if job_status.state == "unknown" else "",
        f"waits for: {job_status.reason}" if job_status.reason else "",
        f"on {job_status.nodes}" if job_status.nodes else "",
        f"exit code {job_status.exit_code}{_meaning(job_status.exit_code)}"
        if job_status.exit_code is not None
        else "",
        f"{job_status.restarts} restarts" if job_status.restarts else "",
    ]
    print(f"{system.name} job {number}: {', '.join(part for part in parts if part)}")


@app.command()
def cancel(job: Job, which: Which = _AUTO, sites: SitesOption = None) -> None:
    """End a job for good. Committed cases stay; `hpc submit` goes on where it stopped."""
    if run_cancel(Path(job), sites):
        return
    system, number = _job(job, which)
    system.cancel(number)
    print(f"{system.name} job {number}: told to end; the same `hpc submit` goes on later")


@app.command()
def requeue(job: Job, which: Which = _AUTO) -> None:
    """Let a running job stop cleanly now and queue itself again, as before the end of its time."""
    system, number = _job(job, which)
    system.requeue(number)
    print(f"{system.name} job {number}: told to stop and to queue itself again")


@app.command(
    help=f"Open an interactive allocation ({_OPENS}) with the set-up that jobs have.",
    context_settings={"allow_interspersed_args": False},
)
@with_options
def shell(
    command: Annotated[
        list[str] | None, typer.Argument(help="Instead of a shell; after `--`.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--print", help="Print the command instead of running it.")
    ] = False,
    *,
    options: Options,
) -> None:
    """Open an interactive allocation with the set-up that jobs have."""
    from hpc.backends import scheduler
    from hpc.commands import become
    from hpc.interactive import shell_command
    from hpc.requested import request_of, scheduler_name
    from hpc.site import load_site

    site = load_site(options.site)
    request = request_of("interactive", options, site, remote_stacks=False)
    system = scheduler(scheduler_name(options, site))
    words = system.interactive(request, shell_command(request, command or []))
    if show:
        print(shlex.join(words))
        return
    become(*words)


@app.command()
def pull(
    source: Annotated[str, typer.Argument(help="HOST:RUN, e.g. login1:work/runs/aeb-256.")],
    folder: Annotated[Path | None, typer.Argument(help="Where to; default runs/RUN, here.")] = None,
) -> None:
    """Copy a run folder from the cluster to this machine, over ssh; again: only what is new.

    A RUN of a job that sees no folder of this machine is copied out of the job's own storage.
    """
    from hpc.pull import pull as pull_run
    from hpc.pull import pull_job

    if pulled := pull_job(Path(source), folder):
        print(pulled)
        return
    print(pull_run(source, folder))


@app.command()
def doctor(
    out: Annotated[Path, typer.Option(help="Where runs would be kept.")] = Path("runs"),
    site: Annotated[Path | None, typer.Option(help="Site file to look at.")] = None,
    output: OutputOption = Output.human,
) -> None:
    """Say what this host offers for campaigns, and what will not work.

    The exit code is 3 if no job can be submitted from here.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from hpc.doctor import judge
    from hpc.look import look
    from hpc.site import load_site

    load_site(site)  # a mistake in it is a line of its own
    facts = look(out.absolute(), site)
    diagnosis = judge(facts)
    if output is Output.json:
        print(json.dumps(diagnosis.as_json(facts)))
    else:
        table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
        for title in ("", "what", "found", "to do"):
            table.add_column(title, overflow="fold")
        for line in diagnosis.lines:
            table.add_row(line.level, line.what, line.found, line.do)
        console = Console()
        console.print(table, markup=False)
        console.print(
            "jobs can be submitted from here" if diagnosis.can_submit else "no job can be submitted"
        )
    if not diagnosis.can_submit:
        raise typer.Exit(EXIT_INFRASTRUCTURE)


def _job(job: str, which: SchedulerName) -> tuple[Scheduler, str]:
    """A run folder's job, or the job with this id."""
    from hpc.backends import scheduler
    from hpc.submit import JOB_FILE, job_of

    submitted = job_of(Path(job))
    if submitted is not None:
        return scheduler(submitted[0]), submitted[1]
    systems = [
        kind
        for kind in batch_systems().declared
        if which in (AUTO, kind.name) and re.fullmatch(kind.job_ids, job)
    ]
    if not systems:
        raise UsageError(
            f"{job}: no run folder with a {JOB_FILE}; give a folder that `hpc submit` has used, "
            "or a job's id"
        )
    # One that is only used where it is named is named by its job's id.
    return scheduler(which if systems[0].submits else systems[0].name), job


def _meaning(code: int) -> str:
    """A campaign with a collision is a job that "failed", for the scheduler."""
    meanings = {
        EXIT_PASS: "all passed",
        EXIT_FAILED: "done, a verdict is not a pass",
        EXIT_UNFINISHED: "unfinished",
    }
    return f" ({meanings[code]})" if code in meanings else ""


def _short(path: str) -> str:
    """Path relative to the working folder if it lies below it."""
    return (
        str(Path(path).relative_to(Path.cwd())) if Path(path).is_relative_to(Path.cwd()) else path
    )


app.command()(scale)
add_commands(app)


def main() -> None:
    """Entry point."""
    run(app, "hpc")
