"""The ``viewer`` command."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load

# isort: split
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.base.cli import Output, OutputOption, duration, make_app
from twin.base.command import run
from twin.base.errors import UsageError
from twin.base.option_record import with_options
from twin.base.process import PARENT_VARIABLE
from twin.base.progress import bars
from twin.fabric.connection_options import KeyOption
from viewer.intervening.commands import register as register_steering
from viewer.live.place import LivePlace
from viewer.playing.commands import register as register_playing

if TYPE_CHECKING:
    from viewer.browser.serve import WebOptions

app = make_app(
    "viewer",
    "Records and shows cases. `conductor run NAME --view record` writes the recordings that "
    "`viewer replay` and `viewer shot` open; `viewer live` shows cases as they run.",
)


register_steering(app)
register_playing(app)


@app.command(hidden=True)
def record(
    connect: str = typer.Option(..., help="Endpoint of a simulator's view."),
    rig: str = typer.Option(..., help="Rig of that simulator."),
    namespace: str = typer.Option("twin", help="Namespace of the conductor."),
    key: KeyOption = None,
) -> None:
    """The recorder process of a rig; started by `twin worker`."""
    from twin.fabric.keys.key_file import load_key
    from twin.fabric.keys.roles import Role
    from viewer.recording.command import run_record

    raise typer.Exit(
        run_record(connect, rig, namespace, load_key(key, Role.worker) if key else None)
    )


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
    case: Annotated[
        str, typer.Argument(help="Case id; none: the wall of the cases that run now.")
    ] = "",
    out: Annotated[Path, typer.Option(help="PNG file to write.")] = Path("shot.png"),
    at: At = "aeb",
    size: Annotated[str, typer.Option(help="Width x height of the picture [px].")] = "1280x720",
    key: KeyOption = None,
    wait: Annotated[
        float, duration("Of the wall: how long running cases are waited for [s].")
    ] = 60.0,
    watch: Annotated[
        float,
        duration("Of the wall: look on first, until verdicts and plots come [s]."),
    ] = 0.0,
) -> None:
    """Render one moment of a recorded case, or the wall of running ones; needs no display."""
    from viewer.playback.folder import find_moment, find_recording
    from viewer.playback.outputs import check_out
    from viewer.playback.shot import parse_size, shoot

    pixels = parse_size(size)
    check_out(out, ".png")
    if not case:
        from viewer.live.command import LiveOptions
        from viewer.live.wall_shot import shoot_wall

        options = LiveOptions(run=folder, key=key, wait_s=wait)
        with bars():
            wall = shoot_wall(options, out, pixels, wait, watch)
        print(f"{out}: {wall.told}")
        return
    recording = find_recording(folder, case)
    moment = find_moment(recording, at)
    with bars():
        shoot(recording.path, moment, out, pixels)
    for line in recording.remarks():
        tell(line)
    print(f"{out}: {case}, {moment.label}")


@app.command()
def frame(
    folder: Folder,
    case: Case,
    out: Annotated[Path, typer.Option(help="PNG file to write.")] = Path("frame.png"),
    at: At = "aeb",
) -> None:
    """Write the camera's picture of a moment with its boxes; needs no graphics driver."""
    from viewer.playback.folder import find_moment, find_recording
    from viewer.playback.frames import read_case
    from viewer.playback.outputs import check_out
    from viewer.playback.still import write_still

    check_out(out, ".png")
    recording = find_recording(folder, case)
    moment = find_moment(recording, at)
    seconds = write_still(read_case(recording.path), moment, out)
    for line in recording.remarks():
        tell(line)
    print(f"{out}: {case}, {moment.label}, picture of {seconds:.2f} s")


@app.command()
def strip(
    folder: Folder,
    case: Case,
    out: Annotated[Path, typer.Option(help="JPEG file to write.")] = Path("strip.jpg"),
    at: At = "aeb",
    around_s: Annotated[float, duration("How long before and after [s].", most=600.0)] = 1.0,
    frames: Annotated[int, typer.Option(min=1, max=15, help="Pictures.")] = 5,
) -> None:
    """Write the camera's pictures around a moment side by side, with boxes; needs no graphics
    driver."""
    from viewer.playback.folder import find_moment, find_recording
    from viewer.playback.frames import read_case
    from viewer.playback.outputs import check_out
    from viewer.playback.strip import write_strip

    check_out(out, ".jpg")
    recording = find_recording(folder, case)
    moment = find_moment(recording, at)
    with bars():
        taken = write_strip(read_case(recording.path), moment, around_s, frames, out)
    for line in recording.remarks():
        tell(line)
    print(f"{out}: {case}, {moment.label}, {len(taken)} pictures")


@app.command(hidden=True)
def strips(
    folder: Folder,
    around_s: Annotated[float, duration("How long before and after [s].", most=600.0)] = 1.0,
    frames: Annotated[int, typer.Option(min=1, max=15, help="Pictures of each.")] = 5,
) -> None:
    """Many strips in one process, for `conductor report`: reads lines of JSON with ``case``, ``at``
    and ``out``, and answers each with a line of ``case`` and ``error``."""
    from viewer.playback.strip import answer_strips

    for line in answer_strips(folder, sys.stdin, around_s, frames):
        print(line, flush=True)


@app.command(hidden=True)
def films(folder: Folder) -> None:
    """Many films in one process, for `conductor report --films`: reads lines of JSON with ``case``
    and ``out``, and answers each with a line of ``case`` and ``error``."""
    from viewer.playback.video import answer_films

    for line in answer_films(folder, sys.stdin):
        print(line, flush=True)


@app.command()
def export(
    folder: Folder,
    case: Case,
    mp4: Annotated[Path | None, typer.Option(help="Film of the camera to write.")] = None,
    mcap: Annotated[
        Path | None, typer.Option(help="MCAP file to write, for Foxglove and the like.")
    ] = None,
    ros2: Annotated[
        bool,
        typer.Option("--ros2", help="The MCAP file holds ROS 2 messages, of the drive's record."),
    ] = False,
    rosbag2: Annotated[
        Path | None,
        typer.Option(help="Folder of rosbag2 to write (metadata.yaml and MCAP); must not exist."),
    ] = None,
    table: Annotated[
        str, typer.Option(help="Topics of ROS 2 messages: plain, nav2, autoware, or a .yaml file.")
    ] = "plain",
    truth: Annotated[
        bool,
        typer.Option(
            "--truth",
            help="With ROS 2: also where the ego and all that moves really were, below /truth.",
        ),
    ] = False,
) -> None:
    """Write a recorded case as a film, an MCAP file or a rosbag2 folder; needs no graphics driver.

    ROS 2 messages are those that a stack behind the bridge gets, byte for byte. They need the
    drive's record (`conductor run --record-drive`); with --truth the recording as well.
    """
    from viewer.playback.folder import find_recording
    from viewer.playback.frames import read_case
    from viewer.playback.mcap_file import write_mcap
    from viewer.playback.outputs import check_out
    from viewer.playback.video import write_film

    if mp4 is None and mcap is None and rosbag2 is None:
        raise UsageError("say what to write: --mp4 FILE, --mcap FILE, --rosbag2 FOLDER")
    if ros2 and mcap is None:
        raise UsageError("--ros2 says what an MCAP file holds; give --mcap FILE as well")
    if (truth or table != "plain") and not (ros2 or rosbag2):
        raise UsageError("--table and --truth are of ROS 2 messages; give --ros2 or --rosbag2")
    for out, suffix in ((mp4, ".mp4"), (mcap, ".mcap")):
        if out is not None:
            check_out(out, suffix)
    if ros2 or rosbag2:
        from viewer.playback.ros2_export import export_ros2

        export_ros2(folder, case, mcap if ros2 else None, rosbag2, table, tell if truth else None)
        mcap = None if ros2 else mcap
        if mp4 is None and mcap is None:
            return
    recording = find_recording(folder, case)
    recorded = read_case(recording.path)
    for line in recording.remarks():
        tell(line)
    if mp4 is not None:
        with bars():
            film = write_film(recorded, mp4)
        if film.held:
            tell(f"{film.held} of {film.frames} pictures are missing; their predecessors stand in")
        length_s = float(film.frames / film.rate_hz)
        print(f"{mp4}: {film.frames} frames at {float(film.rate_hz):g} Hz, {length_s:.2f} s")
    if mcap is not None:
        with bars():
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
    from viewer.playback.catalogue import read_catalogue
    from viewer.playback.folder import find_moment, find_recording
    from viewer.playback.replay import print_catalogue, replay_all
    from viewer.playback.replay import replay as show

    if case:
        if output is Output.json:
            raise UsageError("--output json lists all recordings; leave out the case")
        recording = find_recording(folder, case)
        for line in recording.remarks():
            tell(line)
        show(recording, find_moment(recording, at))
        return
    catalogue = read_catalogue(folder, at)
    for line in catalogue.remarks():
        tell(line)
    print_catalogue(catalogue, output)
    if output is Output.human:
        replay_all(catalogue)


@app.command()
@with_options
def live(
    place: LivePlace = LivePlace(),
    case: Annotated[
        list[str] | None,
        typer.Option(help="Show this case in full as well; up to 8 times."),
    ] = None,
    wait: Annotated[
        float | None,
        duration("Give up without a conductor after this long [s]; default: wait."),
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
    from viewer.live.command import run_live

    _end_with_parent()
    options = place.live(
        cases=tuple(case or ()),
        wait_s=wait,
        port=port,
        show=window,
        json=output is Output.json,
    )
    raise typer.Exit(run_live(options))


@app.command()
@with_options
def web(
    folder: Annotated[
        Path | None,
        typer.Argument(help="Campaign folder, or a folder of several; what runs needs --run."),
    ] = None,
    case: Annotated[str, typer.Argument(help="Case id, to open its recording at once.")] = "",
    place: LivePlace = LivePlace(),
    focus: Annotated[
        list[str] | None,
        typer.Option("--case", help="Live: Rerun's wall has this case in full; up to 8 times."),
    ] = None,
    at: At = "aeb",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Loopback port of the pages; 0: a free one.")
    ] = 0,
    static: Annotated[
        Path | None,
        typer.Option(help="Write the console of a finished campaign as files; serve nothing."),
    ] = None,
    recordings: Annotated[
        bool, typer.Option("--recordings", help="With --static: copy the recordings, too.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Show campaigns and their cases in a browser, finished and running ones, from one loopback
    port, until Ctrl-C."""
    from twin.fabric.discovery import RunEndedError
    from viewer.browser.serve import WebOptions, run_web, write_files
    from viewer.playback.folder import find_moment, find_recording

    places = sum((bool(place.connect), place.run is not None, folder is not None))
    if places > 1 or (not places and place.key is None):
        raise UsageError(
            "give a campaign folder, or for running cases one of --connect tls/HOST:PORT and "
            "--run FOLDER"
        )
    if folder is not None and (place.ssh or place.node):
        raise UsageError(
            "--ssh is for running cases; give --run FOLDER as that host sees it, or start viewer "
            "web over there for the files of a campaign"
        )
    if folder is not None and focus:
        raise UsageError("--case is for running cases; give a recorded one as viewer web DIR CASE")
    if recordings and static is None:
        raise UsageError("--recordings belongs to --static; the served console has them anyway")
    if static is not None and (folder is None or case):
        raise UsageError("--static writes finished campaigns; give viewer web DIR --static OUT")
    as_json = output is Output.json
    if folder is None:
        try:
            options = _what_runs(place, focus or (), port, as_json)
        except RunEndedError:
            folder = place.run  # nothing runs there any more: what came of it is shown
        else:
            raise typer.Exit(run_web(options))
    assert folder is not None
    if static is not None:
        raise typer.Exit(write_files(folder, static, recordings=recordings, as_json=as_json))
    moment = None
    if case:
        recording = find_recording(folder, case)
        for line in recording.remarks():
            tell(line)
        moment = find_moment(recording, at)
    options = WebOptions(port, folder, at, case, moment, json=as_json)
    raise typer.Exit(run_web(options))


def _what_runs(place: LivePlace, focus: Sequence[str], port: int, as_json: bool) -> WebOptions:
    """Options of a console of what a conductor runs.

    Raises:
        RunEndedError: nothing runs there any more.
        UsageError: the options lead nowhere.
    """
    from twin.fabric.keys.roles import Role
    from viewer.browser.serve import WebOptions

    # The page operates; with a viewer's key it says so, and all else is shown.
    where = place.live(role=Role.admin)
    where.check()
    words = [*place.words(), *(f"--case={name}" for name in focus)]
    folder = None if place.ssh else place.run  # with ssh it lies over there
    return WebOptions(port, folder, live=tuple(words), where=where, json=as_json)


def _end_with_parent() -> None:
    """Leave when the `viewer web` that is the parent is gone, however it ended."""
    if not os.environ.pop(PARENT_VARIABLE, ""):
        return

    def wait() -> None:
        while os.read(0, 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()


@app.command("bench")
def bench_command(
    cases: Annotated[int, typer.Option(min=1, max=1000, help="Synthetic live cases.")] = 64,
    focus: Annotated[int, typer.Option(min=0, max=8, help="Cases of these in full.")] = 1,
    console: Annotated[
        int, typer.Option(min=0, max=1000, help="Synthetic cases of the console; 0: none.")
    ] = 256,
    page: Annotated[
        int,
        typer.Option(
            min=0,
            max=20_480,
            help="Measure the console's page with so many cases in Chromium (the targets are for "
            "10240); 0: not.",
        ),
    ] = 0,
    ended: Annotated[
        int, typer.Option(min=0, max=100_000, help="Of a finished campaign in it; 0: none.")
    ] = 10_240,
    seconds: Annotated[float, duration("How long each of them is measured; 0: not [s].")] = 60.0,
    campaign: Annotated[
        str | None,
        typer.Option(help="Run with and without viewers; default: cells of the AEB campaign."),
    ] = None,
    simulate: Annotated[
        int | None,
        typer.Option(min=4, help="Cases of it, the first; default: 32 of ours, all of another."),
    ] = None,
    rounds: Annotated[
        int, typer.Option(min=0, help="Runs of it with nobody, each kind of viewer, and recorded.")
    ] = 3,
    pairs: Annotated[
        int,
        typer.Option(
            min=0, help="Runs of it with a page of the console, each beside one without; 0: none."
        ),
    ] = 0,
    workers: Annotated[int | None, typer.Option(min=1, help="Of these runs.")] = None,
    slots: Annotated[int, typer.Option(min=1, max=4096, help="Of these runs.")] = 1,
    device: Annotated[str, typer.Option(help="Of these runs.")] = "cpu",
    check: Annotated[
        bool, typer.Option("--check", help="Exit with 1 when a target is missed.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Measure what looking costs: the viewer's process, and the simulation's cases per minute."""
    from viewer.bench.command import bench
    from viewer.bench.running import CAMPAIGN, SIMULATED, BenchOptions

    if campaign is None:
        campaign, simulate = str(CAMPAIGN), simulate or SIMULATED
    options = BenchOptions(
        *(
            cases,
            focus,
            console,
            ended,
            seconds,
            campaign,
            rounds,
            simulate,
            workers,
            slots,
            device,
            pairs,
        ),
        page,
    )
    raise typer.Exit(bench(options, as_json=output is Output.json, check=check))


def tell(line: str) -> None:
    """One line for people, on standard error."""
    print(f"viewer: {line}", file=sys.stderr)


def main() -> None:
    """Entry point."""
    try:
        run(app, "viewer")
    except SystemExit as leaving:
        hub = sys.modules.get("viewer.live.hub")
        # A viewer is frozen, and Rerun's own exit hooks would wait for it.
        stuck = hub is not None and hub.STUCK
        # All of it is closed, but threads of libraries may still call a Python that is going: then
        # it aborts (seen once in hundreds of ends).
        if not stuck and "viewer.browser.serve" not in sys.modules:
            raise
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(leaving.code if isinstance(leaving.code, int) else 0)
