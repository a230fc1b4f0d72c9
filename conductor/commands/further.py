"""Commands that measure and explain: benches, keys of a campaign file, shipped campaigns."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from conductor.commands.doctor_command import doctor_command
from conductor.commands.new_command import add_new_commands
from conductor.commands.replay_log_command import replay_log_command
from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError


def add_further_commands(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command("bench")(bench_command)
    app.command("bench-report")(bench_report_command)
    app.command("bench-run")(bench_run_command)
    app.command("bench-search")(bench_search_command)
    app.command("bench-store")(bench_store_command)
    app.command("bench-tls")(bench_tls_command)
    app.command("doctor")(doctor_command)
    add_new_commands(app)
    app.command()(fields)
    app.command("campaigns")(campaigns_command)
    app.command("replay-log")(replay_log_command)


JournalsOption = Annotated[
    Path, typer.Option("--folder", help="Where journals are written; on a real disk.")
]
CheckOption = Annotated[bool, typer.Option("--check", help="Exit with 1 when a target is missed.")]


def bench_command(
    tasks: Annotated[
        int, typer.Option(min=0, help="No-op cases per run of the comparison; 0: none.")
    ] = 4000,
    rounds: Annotated[int, typer.Option(min=1, help="Runs of each scheduler, interleaved.")] = 3,
    cases: Annotated[
        int, typer.Option(min=0, help="Cases of the large campaign, e.g. 100000; 0: none.")
    ] = 0,
    folder: JournalsOption = Path("runs"),
    check: CheckOption = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure durable lease and commit of no-op cases beside dask.distributed and HyperQueue.

    `make install-bench` installs the two; one that is missing is said by name.
    """
    from conductor.bench.command import bench

    as_json = output is Output.json
    raise typer.Exit(bench(tasks, rounds, cases, folder, as_json=as_json, check=check))


def bench_report_command(
    cases: Annotated[int, typer.Option(min=1, help="Cases, rounded up to 256.")] = 10_000,
    folder: Annotated[Path, typer.Option(help="Where the files are written, 0.5 GB.")] = Path(
        "runs"
    ),
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 1 beyond 60 s or 1 GB.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure reports over a large campaign of real files: the first, and those after it."""
    from conductor.bench.report import bench_report

    as_json = output is Output.json
    raise typer.Exit(bench_report(cases, folder, as_json=as_json, check=check))


def bench_run_command(
    cases: Annotated[int, typer.Option(min=8, help="Cases of a run, a multiple of 8.")] = 1000,
    rounds: Annotated[int, typer.Option(min=1, help="Runs of each installation.")] = 5,
    against: Annotated[
        Path | None,
        typer.Option(
            help="Python interpreter of another installation of this project, e.g. of an older "
            "commit; the two take turns."
        ),
    ] = None,
    folder: JournalsOption = Path("runs"),
    check: CheckOption = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure what `conductor run` itself costs, on cases that simulate nothing."""
    from conductor.bench.runs import bench_run

    as_json = output is Output.json
    raise typer.Exit(bench_run(cases, rounds, against, folder, as_json=as_json, check=check))


def bench_search_command(
    chains: Annotated[int, typer.Option(min=1, help="Chains beside which one is measured.")] = 8,
    generation: Annotated[int, typer.Option(min=1, help="Cases of a generation.")] = 50,
    cases: Annotated[int, typer.Option(min=1, help="Cases of a search.")] = 4000,
    slots: Annotated[int, typer.Option(min=1, help="Slots of all workers.")] = 64,
    spread: Annotated[
        float, typer.Option(min=0.0, help="Standard deviation of the logarithm of a case's time.")
    ] = 0.5,
    sampler: Annotated[str, typer.Option(help="A sampler of probabilities.")] = "importance",
    check: CheckOption = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure how busy a search keeps simulated workers, with one chain and with several."""
    from conductor.bench.search import SearchLoad, bench_search

    load = SearchLoad(chains, generation, cases, slots, spread, sampler)
    raise typer.Exit(bench_search(load, as_json=output is Output.json, check=check))


def bench_store_command(
    store: Annotated[
        str, typer.Option(metavar="URL", help="Result store; what is put there stays there.")
    ],
    cases: Annotated[int, typer.Option(min=32, help="No-op cases; a multiple of 32.")] = 100_000,
    rounds: Annotated[
        int, typer.Option(min=1, help="Pairs of runs, without a store and with one.")
    ] = 3,
    folder: JournalsOption = Path("runs"),
    check: CheckOption = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure what a result store costs a conductor, and how long a takeover takes."""
    from conductor.bench.store import bench_store

    as_json = output is Output.json
    raise typer.Exit(bench_store(cases, rounds, store, folder, as_json=as_json, check=check))


def bench_tls_command(
    cases: Annotated[int, typer.Option(min=1, help="No-op cases per run.")] = 2000,
    rounds: Annotated[int, typer.Option(min=1, help="Runs of each, plain and TLS in turns.")] = 3,
    folder: JournalsOption = Path("runs"),
    check: CheckOption = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure what mutual TLS costs: lease and commit, and messages and pictures of a rig."""
    from conductor.bench.tls import bench_tls

    as_json = output is Output.json
    raise typer.Exit(bench_tls(cases, rounds, folder, as_json=as_json, check=check))


def fields(
    key: Annotated[
        str, typer.Argument(help="Only keys that begin so, e.g. camera; default: all.")
    ] = "",
    output: OutputOption = Output.human,
) -> None:
    """Explain the keys of a campaign file: what is allowed, the default, the meaning."""
    from conductor.commands.tables import key_table
    from schemas.campaign import Campaign
    from schemas.reference import keys_of
    from schemas.validation import suggest

    known = keys_of(Campaign)
    top = [field.path for field in known if "." not in field.path]
    chosen = [field for field in known if field.path.startswith(key)]
    if not chosen:
        raise UsageError(f"no key '{key}'; {suggest(key, top)}")
    if output is Output.json:
        print(json.dumps([asdict(field) for field in chosen]))
    else:
        key_table(chosen)


def campaigns_command() -> None:
    """List the shipped campaigns."""
    from conductor.run.source import listed, shipped

    for name in shipped():
        cases, description = listed(name)
        print(f"{name:22} {cases:5} cases  {description}")
