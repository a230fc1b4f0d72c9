"""``hpc scale``, and what ``hpc status`` and ``hpc cancel`` say of a run on several sites."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import duration
from twin.base.errors import InfrastructureError, TwinError, UsageError

OnOption = Annotated[
    list[str] | None,
    typer.Option("--on", help="KIND:SITE of the sites file, repeatable, e.g. slurm:north."),
]
SitesOption = Annotated[
    Path | None,
    typer.Option(help="Sites file; default ~/.config/drivetwin/sites.yaml."),
]


def scale(
    run: Annotated[Path, typer.Argument(help="Run folder, e.g. runs/aeb-256.")],
    target: Annotated[str, typer.Option(help="MIN:MAX workers altogether, e.g. 0:32.")],
    on: OnOption = None,
    sites: SitesOption = None,
    key: Annotated[
        Path | None,
        typer.Option(help="Key of a worker, where the conductor runs elsewhere; it names it."),
    ] = None,
    time: Annotated[
        str, typer.Option(help="Longest duration of an allocation, HH:MM, unless its site says.")
    ] = "",
    workers: Annotated[int, typer.Option(help="Workers of one, unless its site says.")] = 0,
    gpus: Annotated[int, typer.Option(help="Or GPUs of one, unless its site says.")] = 0,
    slots: Annotated[int | None, typer.Option(help="Cases together per worker.")] = None,
    worker_hours: Annotated[
        float | None, typer.Option(min=0.0, help="Most worker-hours to ask for altogether [h].")
    ] = None,
    worthwhile_s: Annotated[
        float, duration("Work that one more worker should find, at least [s].", least=1.0)
    ] = 60.0,
    period_s: Annotated[float, duration("Time between two looks [s].", least=0.1)] = 10.0,
    once: Annotated[bool, typer.Option("--once", help="Look once, act, and end.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Look once and say what would be done.")
    ] = False,
) -> None:
    """Ask sites for workers as a run needs them, and end those that have nothing to do.

    Every step says why, also in scale.jsonl of the run folder. It may be killed at any moment: the
    same command goes on, and asks for nothing twice. It ends when every case has ended.
    """
    from hpc.sites.command import parse_target, scale
    from hpc.sites.file import chosen_sites, load_sites
    from hpc.sites.requests import CommonOptions
    from hpc.sites.scaling import WorkerTarget

    least, most = parse_target(target)
    if not on:
        raise UsageError("where? give --on KIND:SITE, e.g. --on slurm:north")
    file = load_sites(sites)
    code = scale(
        run.absolute(),
        chosen_sites(on, file),
        file=file,
        key=key.absolute() if key is not None else None,
        target=WorkerTarget(least, most, worker_hours, worthwhile_s),
        common=CommonOptions(time=time, workers=workers, gpus=gpus, slots=slots),
        period_s=period_s,
        dry_run=dry_run,
        once=once,
        say=print,
    )
    raise typer.Exit(code)


def run_status(run: Path, sites: Path | None, *, as_json: bool) -> bool:
    """Print the allocations of a run on several sites; False: ``run`` is none."""
    from time import time

    from hpc.sites.command import reopened

    book = reopened(run.absolute(), sites)
    if book is None:
        return False
    lines = book.look(set(), time())
    allocations = book.book.allocations
    if as_json:
        rows = [
            {"id": a.id, "site": a.site, "job": a.job, "state": a.state, "why": a.why}
            for a in allocations
        ]
        print(json.dumps({"allocations": rows}))
        return True
    for each in allocations:
        job = f"{each.scheduler} job {each.job}" if each.job else "not submitted"
        print(f"{each.id}: {each.state}, {job}, {each.why}")
    if not lines and not allocations:
        print("no allocation was asked for")
    return True


def run_cancel(run: Path, sites: Path | None) -> bool:
    """End all allocations of a run on several sites, and its conductor; False: it is none."""
    from time import time

    from hpc.sites.allocations import alone, book_of
    from hpc.sites.command import dismiss, reopened

    if book_of(run) is None:
        return False
    failures = []
    with alone(run):
        book = reopened(run.absolute(), sites)
        assert book is not None
        for each in book.open:
            try:
                book.end(each, "cancelled", time())
                print(f"{each.id}: told to end")
            except TwinError as error:
                failures.append(f"{each.id}: {error}")
    if dismiss(run.absolute()):
        print("conductor: told to end; the same `hpc submit` goes on later")
    if failures:
        raise InfrastructureError("\n".join(failures))
    return True
