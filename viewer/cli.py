"""The ``viewer`` command."""

from __future__ import annotations

import twin.fabric.start  # noqa: F401 - before anything that takes long to load

# isort: split
import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.fabric.cli import KeyOption, Output, OutputOption, make_app, run
from twin.fabric.errors import UsageError

app = make_app(
    "viewer",
    "Records and shows cases. `conductor run NAME --view record` writes the recordings that "
    "`viewer replay` and `viewer shot` open; `viewer live` shows cases as they run.",
)


@app.command(hidden=True)
def record(
    connect: str = typer.Option(..., help="Endpoint of a simulator's view feed."),
    rig: str = typer.Option(..., help="Rig of that feed."),
    namespace: str = typer.Option("twin", help="Namespace of the conductor."),
    key: KeyOption = None,
) -> None:
    """The recorder process of a rig; started by `twin worker`."""
    from twin.fabric.key_file import load_key
    from viewer.record import run_record

    raise typer.Exit(run_record(connect, rig, namespace, load_key(key) if key else None))


Folder = Annotated[Path, typer.Argument(help="Campaign folder, e.g. runs/aeb-demo.")]
Case = Annotated[str, typer.Argument(help="Case id, a folder name below its cases/.")]
At = Annotated[
    str,
    typer.Option(help="aeb (without a trigger: closest approach), or seconds of sim time."),
]


@app.command()
def shot(
    folder: Folder,
    case: Case,
    out: Annotated[Path, typer.Option(help="PNG file to write.")] = Path("shot.png"),
    at: At = "aeb",
    size: Annotated[str, typer.Option(help="Width x height of the picture [px].")] = "1280x720",
) -> None:
    """Render one moment of a recorded case as a picture; needs no display."""
    from viewer.folder import find_moment, find_recording
    from viewer.shot import check_out, parse_size, shoot

    pixels = parse_size(size)
    check_out(out)
    found = find_recording(folder, case)
    moment = find_moment(found, at)
    shoot(found.path, moment, out, pixels)
    if not found.complete:
        tell(f"{found.path}: the recording is incomplete")
    print(f"{out}: {case}, {moment.label}")


@app.command()
def replay(folder: Folder, case: Case, at: At = "aeb") -> None:
    """Open a recorded case in the native viewer, paused at a moment."""
    from viewer.folder import find_moment, find_recording
    from viewer.replay import replay as show

    found = find_recording(folder, case)
    if not found.complete:
        tell(f"{found.path}: the recording is incomplete")
    show(found, find_moment(found, at))


@app.command()
def live(
    connect: Annotated[
        str, typer.Option(help="The conductor's endpoint, e.g. tls/login1:7447.")
    ] = "",
    run_folder: Annotated[
        Path | None,
        typer.Option("--run", help="Or: campaign or state folder, on a shared file system."),
    ] = None,
    ssh: Annotated[
        str,
        typer.Option(help="Open a tunnel: --run or --connect as this host sees it, e.g. me@login."),
    ] = "",
    node: Annotated[
        str, typer.Option(help="With --ssh: host behind it that the tunnel ends at, e.g. cn042.")
    ] = "",
    case: Annotated[
        list[str] | None,
        typer.Option(help="Show this case in full as well; up to 8 times."),
    ] = None,
    namespace: Annotated[str, typer.Option(help="Namespace of the conductor.")] = "twin",
    key: KeyOption = None,
    wait: Annotated[
        float | None,
        typer.Option(min=0, help="Give up without a conductor after this long [s]; default: wait."),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Loopback port of the hub; 0: a free one.")
    ] = 0,
    window: Annotated[
        bool, typer.Option(help="Open the native viewer here if there is a display.")
    ] = True,
    output: OutputOption = Output.human,
) -> None:
    """Show the running cases, here or on a laptop behind ssh, until Ctrl-C.

    It may be started before the conductor, and finds one again that was restarted or cut off.
    """
    from viewer.live import LiveOptions, run_live

    if bool(connect) == (run_folder is not None):
        raise UsageError("give one of --connect tls/HOST:PORT and --run FOLDER")
    if node and not ssh:
        raise UsageError("--node is reached through --ssh me@login; give both")
    options = LiveOptions(
        connect=connect,
        run=run_folder,
        ssh=ssh,
        node=node,
        namespace=namespace,
        key=key,
        cases=tuple(case or ()),
        wait_s=wait,
        port=port,
        show=window,
        json=output is Output.json,
    )
    raise typer.Exit(run_live(options))


@app.command("bench")
def bench_command(
    cases: Annotated[int, typer.Option(min=1, max=1000, help="Synthetic live cases.")] = 64,
    focus: Annotated[int, typer.Option(min=0, max=8, help="Cases of these in full.")] = 1,
    seconds: Annotated[
        float, typer.Option(min=0, help="How long the viewer is measured; 0: not [s].")
    ] = 60.0,
    campaign: Annotated[
        str, typer.Option(help="Campaign that is run with and without viewers.")
    ] = "aeb-demo",
    rounds: Annotated[
        int, typer.Option(min=0, help="Runs of it with nobody, a viewer, a frozen viewer.")
    ] = 3,
    workers: Annotated[int | None, typer.Option(min=1, help="Of these runs.")] = None,
    slots: Annotated[int, typer.Option(min=1, max=4096, help="Of these runs.")] = 1,
    device: Annotated[str, typer.Option(help="Of these runs.")] = "cpu",
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 1 when a target is missed.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure what looking costs: the viewer's process, and the simulation's cases per minute."""
    from viewer.bench import BenchOptions, bench

    options = BenchOptions(cases, focus, seconds, campaign, rounds, workers, slots, device)
    raise typer.Exit(bench(options, as_json=output is Output.json, check=check))


def tell(line: str) -> None:
    """One line for people, on standard error."""
    print(f"viewer: {line}", file=sys.stderr)


def main() -> None:
    """Entry point."""
    run(app, "viewer")
