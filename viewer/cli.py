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
AnyCase = Annotated[str, typer.Argument(help="Case id; none: all cases that were recorded.")]
At = Annotated[
    str,
    typer.Option(
        help="aeb (without a trigger: closest approach), closest, or seconds of sim time."
    ),
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
    from viewer.outputs import check_out
    from viewer.shot import parse_size, shoot

    pixels = parse_size(size)
    check_out(out, ".png")
    found = find_recording(folder, case)
    moment = find_moment(found, at)
    shoot(found.path, moment, out, pixels)
    if not found.complete:
        tell(f"{found.path}: the recording is incomplete")
    print(f"{out}: {case}, {moment.label}")


@app.command()
def frame(
    folder: Folder,
    case: Case,
    out: Annotated[Path, typer.Option(help="PNG file to write.")] = Path("frame.png"),
    at: At = "aeb",
) -> None:
    """Write the camera's picture of a moment with its boxes; needs no graphics driver."""
    from viewer.folder import find_moment, find_recording
    from viewer.frames import read_case
    from viewer.outputs import check_out
    from viewer.still import write_still

    check_out(out, ".png")
    found = find_recording(folder, case)
    moment = find_moment(found, at)
    seconds = write_still(read_case(found.path), moment, out)
    if not found.complete:
        tell(f"{found.path}: the recording is incomplete")
    print(f"{out}: {case}, {moment.label}, picture of {seconds:.2f} s")


@app.command()
def export(
    folder: Folder,
    case: Case,
    mp4: Annotated[Path | None, typer.Option(help="Film of the camera to write.")] = None,
    mcap: Annotated[
        Path | None, typer.Option(help="MCAP file to write, for Foxglove and the like.")
    ] = None,
) -> None:
    """Write a recorded case as a film or an MCAP file; needs no graphics driver."""
    from viewer.folder import find_recording
    from viewer.frames import read_case
    from viewer.mcap_file import write_mcap
    from viewer.outputs import check_out
    from viewer.video import write_film

    if mp4 is None and mcap is None:
        raise UsageError("say what to write: --mp4 FILE, --mcap FILE, or both")
    for out, suffix in ((mp4, ".mp4"), (mcap, ".mcap")):
        if out is not None:
            check_out(out, suffix)
    found = find_recording(folder, case)
    recorded = read_case(found.path)
    if not found.complete:
        tell(f"{found.path}: the recording is incomplete")
    if mp4 is not None:
        film = write_film(recorded, mp4)
        if film.held:
            tell(f"{film.held} of {film.frames} pictures are missing; their predecessors stand in")
        length_s = float(film.frames / film.rate_hz)
        print(f"{mp4}: {film.frames} frames at {float(film.rate_hz):g} Hz, {length_s:.2f} s")
    if mcap is not None:
        written = write_mcap(recorded, mcap)
        print(f"{mcap}: {written.messages} messages, {written.end_ns / 1e9:.2f} s")


@app.command()
def replay(
    folder: Folder,
    case: AnyCase = "",
    at: At = "aeb",
    output: OutputOption = Output.human,
) -> None:
    """Open a recorded case in the native viewer, paused at a moment; or the table of all cases.

    With --output json nothing is opened.
    """
    from viewer.catalogue import read_catalogue
    from viewer.folder import find_moment, find_recording
    from viewer.replay import print_catalogue, replay_all
    from viewer.replay import replay as show

    if case:
        if output is Output.json:
            raise UsageError("--output json lists all recordings; leave out the case")
        found = find_recording(folder, case)
        if not found.complete:
            tell(f"{found.path}: the recording is incomplete")
        show(found, find_moment(found, at))
        return
    catalogue = read_catalogue(folder, at)
    for line in catalogue.remarks():
        tell(line)
    print_catalogue(catalogue, output)
    if output is Output.human:
        replay_all(catalogue)


@app.command()
def live(
    connect: Annotated[
        str, typer.Option(help="The conductor's endpoint, e.g. tls/login1:7447.")
    ] = "",
    run_folder: Annotated[
        Path | None,
        typer.Option("--run", help="Or: campaign or state folder, on a shared file system."),
    ] = None,
    namespace: Annotated[str, typer.Option(help="Namespace of the conductor.")] = "twin",
    key: KeyOption = None,
    wait: Annotated[
        float, typer.Option(min=0, help="With --run: wait this long for a conductor [s].")
    ] = 0.0,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Loopback port of the hub; 0: a free one.")
    ] = 0,
    window: Annotated[
        bool, typer.Option(help="Open the native viewer here if there is a display.")
    ] = True,
    output: OutputOption = Output.human,
) -> None:
    """Show the running cases, here or on a laptop behind ssh, until Ctrl-C."""
    from twin.fabric.discovery import await_conductor, choose_target
    from viewer.live import LiveOptions, run_live

    if bool(connect) == (run_folder is not None):
        raise UsageError("give one of --connect tls/HOST:PORT and --run FOLDER")
    if run_folder is not None:
        target = await_conductor(run_folder, wait, key)
    else:
        target = choose_target(connect, None, namespace, key)
    options = LiveOptions(
        target.endpoint, target.namespace, target.key, port, window, output is Output.json
    )
    raise typer.Exit(run_live(options))


def tell(line: str) -> None:
    """One line for people, on standard error."""
    print(f"viewer: {line}", file=sys.stderr)


def main() -> None:
    """Entry point."""
    run(app, "viewer")
