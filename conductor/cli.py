"""The ``conductor`` command."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load
from schemas.sections.view_mode import ViewMode
from schemas.words import counted

# isort: split
import json
import logging
import sys
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from conductor.commands.further import add_further_commands
from conductor.commands.key_commands import add_key_commands, own_key
from conductor.commands.operate import add_commands
from conductor.commands.options import (
    AllowUnprotected,
    Axes,
    ByBatch,
    CampaignToServe,
    Device,
    Durable,
    DurableIn,
    FilmsOf,
    FirstCases,
    History,
    Listen,
    MemoryGb,
    Metrics,
    OneCase,
    OnOff,
    Quick,
    RecordDrive,
    Render,
    Reported,
    Rows,
    RunFolder,
    Seed,
    Settings,
    Slots,
    Source,
    StateFolder,
    Store,
    TimeToLive,
    UntilDone,
    View,
    Weather,
    Workers,
)
from conductor.commands.report_commands import FetchedRecordings, add_report_commands
from twin.base.cli import Output, OutputOption, make_app
from twin.base.command import run
from twin.base.errors import (
    EXIT_INFRASTRUCTURE,
    EXIT_USAGE,
    UsageError,
)
from twin.base.option_record import with_options
from twin.base.process import keep_to_itself
from twin.base.progress import bars
from twin.fabric.connection_options import (
    ConductorOptions,
    InsecureOption,
    KeyOption,
    NamespaceOption,
)
from twin.fabric.endpoint import LOOPBACK, NAMESPACE

if TYPE_CHECKING:
    from conductor.stored.link import StoreOptions

app = make_app(
    "conductor",
    "Runs campaigns of test cases. `conductor run aeb-demo` does it all on this machine; "
    "`conductor serve`, `conductor submit` and `twin worker` do it process by process, on many.",
)


def strangers_named() -> AbstractContextManager[None]:
    """Clients that do not get in at our listener are said on standard error while the block
    lasts."""
    from twin.fabric.refusals import refusals_logged

    return refusals_logged(logging.getLogger("conductor").warning)


@app.command("run")
def run_command(
    campaign: Source,
    out: RunFolder = None,
    workers: Workers = None,
    slots: Slots = None,
    device: Device = "cpu",
    seed: Seed = None,
    case: OneCase = "",
    cases: FirstCases = None,
    rows: Rows = "",
    quick: Quick = False,
    weather: Weather = "",
    axis: Axes = None,
    setting: Settings = None,
    by_batch: ByBatch = False,
    history: History = None,
    listen: Listen = LOOPBACK,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    view: View = None,
    record_drive: RecordDrive = False,
    render: Render = None,
    memory_gb: MemoryGb = None,
    store: Store = "",
    durable: DurableIn = Durable.local,
    output: OutputOption = Output.human,
) -> None:
    """Serve, start local workers, wait, report: a whole campaign with one command.

    The same command again resumes where it stopped. For workers that you start yourself it is
    `conductor serve --campaign NAME --until-done`.
    """
    from conductor.run.changes import typed_changes
    from conductor.run.requested import RunRequest, made_ready

    request = RunRequest(
        campaign=campaign,
        changes=typed_changes(axis, setting),
        out=out,
        workers=workers,
        slots=slots,
        device=device,
        seed=seed,
        case=case,
        cases=cases,
        rows=rows,
        quick=quick,
        weather=weather,
        by_batch=by_batch,
        history=history,
        listen=listen,
        view=view,
        record_drive=record_drive,
        render=None if render is None else render is OnOff.on,
        memory_gb=memory_gb,
        store=_store_options(store, durable),
        json=output is Output.json,
    )
    with made_ready(request) as ready:
        from conductor.run.command import run_campaign

        options = replace(ready.options, key=own_key(key, insecure=insecure))
        with strangers_named():
            raise typer.Exit(run_campaign(ready.plan, options, ready.workers, ready.computed))


@app.command()
def serve(
    state: StateFolder = None,
    campaign: CampaignToServe = "",
    until_done: UntilDone = False,
    listen: Listen = LOOPBACK,
    namespace: NamespaceOption = NAMESPACE,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    by_batch: ByBatch = False,
    ttl_s: TimeToLive = 15.0,
    view: View = None,
    metrics: Metrics = "",
    allow_unprotected: AllowUnprotected = False,
    store: Store = "",
    durable: DurableIn = Durable.local,
    history: History = None,
) -> None:
    """Serve a state folder until stopped; started again, it goes on where it was.

    With --campaign and --until-done it is `conductor run` for workers that you start yourself
    (`twin worker --state FOLDER --until-done`), as job scripts do.
    """
    if bool(campaign) is not until_done:
        raise UsageError("give --campaign and --until-done, or none and use `conductor submit`")
    keep_to_itself()
    kept_in = _store_options(store, durable)
    fabric_key = own_key(key, insecure=insecure)
    if metrics:
        from conductor.serve.metrics import checked_address

        checked_address(metrics)
    with strangers_named():
        if campaign:
            from conductor.run.requested import checked_plan
            from conductor.run.source import begun

            plan = begun(checked_plan(campaign))
            # Here, because only this way of serving needs it.
            from conductor.run.command import RunOptions, serve_until_done

            options = RunOptions(
                out=state or Path("runs") / plan.campaign.campaign,
                by_batch=by_batch,
                listen=listen,
                namespace=namespace,
                key=fabric_key,
                ttl_s=ttl_s,
                view=view,
                metrics=metrics,
                store=kept_in,
                history=history,
            )
            raise typer.Exit(serve_until_done(plan, options))
        from conductor.serve.command import serve_folder

        code = serve_folder(
            state or Path("runs"),
            listen,
            namespace,
            key=fabric_key,
            by_batch=by_batch,
            ttl_s=ttl_s,
            view=view,
            metrics=metrics,
            allow_unprotected=allow_unprotected,
            store=kept_in,
            history=history,
        )
    raise typer.Exit(code)


def _store_options(url: str, durable: Durable) -> StoreOptions | None:
    """Result store of the command line; None: none was given."""
    if not url:
        if durable is Durable.store:
            raise UsageError("--durable store belongs to --store; give both or none")
        return None
    from conductor.stored.link import StoreOptions
    from twin.stores.opening import open_store

    options = StoreOptions(url, durable is Durable.store)
    open_store(url)  # a missing package is said before anything starts
    return options


@app.command()
@with_options
def submit(
    campaign: Source,
    conductor: ConductorOptions = ConductorOptions(),
    out: Annotated[
        Path | None, typer.Option(help="Campaign folder, as the conductor sees it.")
    ] = None,
    seed: Seed = None,
    rows: Rows = "",
    quick: Quick = False,
    weather: Weather = "",
    axis: Axes = None,
    setting: Settings = None,
    priority: Annotated[
        int, typer.Option(help="Higher ones are served first; equals share the workers.")
    ] = 0,
) -> None:
    """Submit a campaign to a conductor that serves; it takes a key of role submitter.

    Workers run what a campaign names, so an invitation of role admin does not open this.
    """
    from conductor.commands.client import client_of
    from conductor.run.changes import typed_changes
    from conductor.run.requested import checked_plan
    from conductor.run.source import begun, of_rows
    from twin.fabric.keys.roles import Role

    changes = typed_changes(axis, setting)
    plan = checked_plan(campaign, seed=seed, weather=weather, changes=changes)
    loaded = begun(of_rows(plan, rows, quick=quick)).campaign
    with client_of(conductor, Role.submitter) as client:
        folder = client.submit(loaded, str(out.absolute()) if out else "", priority)
    print(f"submitted {loaded.campaign}: results in {folder}")


@app.command()
@with_options
def status(
    conductor: ConductorOptions = ConductorOptions(),
    watch: Annotated[
        bool, typer.Option("--watch", help="Keep showing it until every case has ended.")
    ] = False,
    cases: Annotated[
        bool, typer.Option("--cases", help="List the cases that run now, and where.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Show campaigns and workers of a conductor that serves, or the cases that run."""
    from rich.console import Console

    from conductor.commands.client import client_of
    from conductor.commands.tables import running_table, status_tables
    from conductor.commands.watch import watch as watch_status
    from twin.fabric.keys.roles import Role

    if watch and cases:
        raise UsageError("--cases lists what runs at one moment; leave --watch away")
    with client_of(conductor, Role.viewer) as client:
        if watch:
            as_json = output is Output.json
            raise typer.Exit(watch_status(client, Console(), as_json=as_json))
        answer = client.status(running=cases)
    if output is Output.json:
        print(json.dumps(answer))
    elif cases:
        running_table(answer["running"])
    else:
        status_tables(answer)


@app.command()
@with_options
def stop(
    conductor: ConductorOptions = ConductorOptions(),
) -> None:
    """Drain a conductor: workers give their cases back and leave, then it ends."""
    from conductor.commands.client import client_of

    with client_of(conductor) as client:
        client.stop()
    print("draining; run `conductor serve` again to go on")


add_commands(app)
add_key_commands(app)


@app.command("relay")
@with_options
def relay_command(
    listen: Annotated[str, typer.Option(help="Where to listen, e.g. tls/0.0.0.0:7447.")],
    conductor: ConductorOptions = ConductorOptions(),
) -> None:
    """Pass on between a conductor and workers of another cluster that cannot reach its host.

    Run it where both sides can connect, e.g. on a login node; it takes the conductor's own key.
    """
    from conductor.serve.relay import relay
    from twin.fabric.keys.roles import Role

    target = conductor.target(Role.conductor)
    with strangers_named():
        raise typer.Exit(relay(target, listen, None if conductor.connect else conductor.state))


@app.command()
def validate(
    campaign: Source,
    fetch: Annotated[
        bool,
        typer.Option("--fetch", help="Also fetch its stack's repository and run the set-up."),
    ] = False,
    rows: Rows = "",
    quick: Quick = False,
    weather: Weather = "",
    axis: Axes = None,
    setting: Settings = None,
    output: OutputOption = Output.human,
) -> None:
    """Check a campaign file, and tell in one line what is wrong with it; lists its cases.

    Nothing of it is run: a repository's set-up is only told.
    """
    from conductor.run.changes import typed_changes
    from conductor.run.requested import checked_plan
    from conductor.run.source import of_rows, stack_paths

    try:
        changes = typed_changes(axis, setting)
        plan = checked_plan(campaign, fetch=fetch, weather=weather, changes=changes)
        plan = of_rows(plan, rows, quick=quick)
    except UsageError as error:
        if output is Output.json:
            print(json.dumps({"valid": False, "mistakes": str(error).splitlines()}))
            raise typer.Exit(EXIT_USAGE) from None
        raise
    loaded, cases = plan.campaign, plan.cases
    if output is Output.json:
        facts = {
            "valid": True,
            "mistakes": [],
            "cases": [case.id for case in cases],
            "deadline_s": loaded.deadline_s,
            "placement": loaded.autonomy.placement,
            "commands": bool(loaded.autonomy.command),
            "records": loaded.recording.drive != "none"
            or (ViewMode(loaded.view).records and loaded.recording.keep != "none"),
            "drive_records": loaded.recording.drive != "none",
            "files": sorted(loaded.files),
            "paths": stack_paths(loaded),
        }
        print(json.dumps(facts))
        return
    print(
        f"{campaign}: valid, {counted(len(cases), 'case')}, "
        f"e.g. {', '.join(case.id for case in cases[:3])}"
    )
    repository = loaded.autonomy.repository
    if repository is not None and not fetch:
        setup = f", then `{repository.setup}` is run there" if repository.setup else ""
        print(
            f"autonomy.repository: {repository.url} at {repository.ref} is fetched where the "
            f"campaign is run{setup}; --fetch does so now"
        )


add_report_commands(app)


@app.command()
def report(
    folder: Reported = None,
    import_autodrive: Annotated[
        Path | None,
        typer.Option(
            help="Or: a folder with config.json and batch_N/aeb_metrics_sim_inst_M.csv of the "
            "AutoDRIVE study; they become a campaign folder first."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for an import, default runs/imported-DIR, or for what is read from a "
            "store, default runs/CAMPAIGN."
        ),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            help="Write a result page, .md, with its pictures in a folder beside it; what was "
            "written into it by hand stays."
        ),
    ] = None,
    serial: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the same campaign, run with --workers 1 --slots 1: the speed-up is "
            "measured against it."
        ),
    ] = None,
    anew: Annotated[
        bool, typer.Option("--anew", help="Read every KPI file again, also unchanged ones.")
    ] = False,
    films: Annotated[
        FilmsOf | None,
        typer.Option(
            help="failures: make films of recorded cases that did not pass, of a rulebook's tables "
            "the worst run of each cell; the page leads to them. A result page has ends of some."
        ),
    ] = None,
    recordings: FetchedRecordings = None,
    output: OutputOption = Output.human,
) -> None:
    """Write report.html, summary.parquet, summary.csv and plots of a campaign folder, also while
    the campaign runs.

    Exit code 1: a verdict is not a pass; 75: cases have not ended; 3: cases are unresolved, or
    results are damaged or disagree, which the page shows as alarms.
    """
    from conductor.commands.report_commands import report_folder
    from conductor.report import make_report, tables_of, write_result_page
    from conductor.report.pages.content import first_screen
    from conductor.trust.sign_run import sign_derived

    run = report_folder(folder, import_autodrive, out, recordings)
    with bars():
        made = make_report(run, anew=anew, serial=serial, films=films is FilmsOf.failures)
        sign_derived(run)
        pages = [made.page, *sorted({path.parent for path in (*made.plots, *made.films)})]
        if markdown is not None:
            pages.append(write_result_page(run, markdown, films=films is FilmsOf.failures))
    as_json = output is Output.json
    print(json.dumps(tables_of(made.content)) if as_json else "\n".join(map(str, pages)))
    alarms = made.content.evidence.alarms
    first = first_screen(made.content.dossier)
    for line in [*first, made.plots_missing, *made.films_missing, *alarms]:
        if line:
            print(f"conductor: {line}", file=sys.stderr)
    raise typer.Exit(EXIT_INFRASTRUCTURE if alarms else made.content.dossier.exit_code)


add_further_commands(app)


def main() -> None:
    """Entry point."""
    # Progress goes to stderr; results alone go to stdout, also when it is a pipe.
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    run(app, "conductor")
