"""The ``twin`` command."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load

# isort: split
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.base.cli import Output, OutputOption, make_app
from twin.base.command import run
from twin.base.errors import UnfinishedError, UnreachableError, UsageError
from twin.base.progress import bars
from twin.bench.command import app as bench_app
from twin.dataset.command_options import (
    BatchOption,
    CameraOption,
    CamerasOption,
    CountOption,
    FileFormatOption,
    JobsOption,
    OtherSceneOption,
    OutArgument,
    PreviewOption,
    QualityOption,
    RuleOption,
    SceneOption,
    SeedOption,
    SizeOption,
    SplitSharesOption,
    StreetsOption,
    VehicleOption,
)
from twin.drives.command import replay_log
from twin.fabric.connection_options import InsecureOption, KeyOption, NamespaceOption
from twin.fabric.endpoint import LOOPBACK, NAMESPACE
from twin.play.command import play
from twin.scenario.free_driving.command import driving
from twin.validate.command import app as validate_app
from twin.worker.command_options import (
    AwaySOption,
    ConnectOption,
    CoresOption,
    DrainSOption,
    DriveListenOption,
    ExplainOption,
    JoinDirOption,
    MemoryGbOption,
    SiteOption,
    SlotsOption,
    SpoolOption,
    StartedAgainOption,
    StateOption,
    TagOption,
    UntilDoneOption,
    ViewOption,
    WaitOption,
    WalltimeSOption,
    checked_site,
)

if TYPE_CHECKING:
    from schemas.sections.view_mode import ViewMode
    from twin.fabric.discovery import Target

app = make_app("twin", "The simulator. `twin worker` runs the cases that a conductor leases to it.")
app.add_typer(validate_app, name="validate")
app.add_typer(bench_app, name="bench")
app.command()(play)
app.command()(driving)
app.command("replay-log", hidden=True)(replay_log)

Device = Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")]


@app.command()
def worker(
    connect: ConnectOption = "",
    state: StateOption = None,
    wait: WaitOption = 0.0,
    namespace: NamespaceOption = NAMESPACE,
    key: KeyOption = None,
    _insecure: InsecureOption = False,
    slots: SlotsOption = None,
    device: Device = "cpu",
    cores: CoresOption = "",
    explain: ExplainOption = False,
    drive_listen: DriveListenOption = LOOPBACK,
    join_dir: JoinDirOption = "",
    view: ViewOption = None,
    until_done: UntilDoneOption = False,
    started_again: StartedAgainOption = False,
    away_s: AwaySOption = None,
    drain_s: DrainSOption = 0.0,
    walltime_s: WalltimeSOption = None,
    memory_gb: MemoryGbOption = None,
    tag: TagOption = None,
    site: SiteOption = "",
    spool: SpoolOption = None,
) -> None:
    """Lease cases from a conductor and run them until told to stop (Ctrl-C, SIGTERM)."""
    _prepare(cores, view)
    if explain:
        _explain(device)
        return
    from twin.base.process import keep_to_itself
    from twin.worker.options import GPU_SLOTS, WorkerOptions
    from twin.worker.shell import Worker

    keep_to_itself()  # its session and its keys are nothing for a stack of the same user
    spool = spool or (state / "spool" if state is not None and not connect else None)
    target = _conductor(connect, state, wait, namespace, key, again=started_again)
    options = WorkerOptions(
        connect=target.endpoint,
        namespace=target.namespace,
        key=target.key,
        key_path=target.key.path if target.key else None,
        slots=slots or (GPU_SLOTS if device.startswith("cuda") else 1),
        fit=slots is None and device.startswith("cuda"),
        device=device,
        drive_listen=drive_listen,
        join_dir=join_dir,
        view=view,
        until_done=until_done,
        started_again=started_again,
        away_s=away_s,
        drain_s=drain_s,
        walltime_s=walltime_s,
        memory_gb=memory_gb,
        tags=tuple(tag or ()),
        site=checked_site(site),
        spool=spool,
    )
    raise typer.Exit(Worker(options).serve())


def _prepare(cores: str, view: ViewMode | None) -> None:
    """Stay on the worker's cores; refuse to record where that cannot be, before anybody waits."""
    if cores:
        from twin.worker.allocation import stay_on

        stay_on(cores)
    if view is not None and view.records:
        from twin.worker.options import lacking_recorder

        lacking_recorder(view)


def _explain(device: str) -> None:
    from twin.worker.explain import explanation

    print("\n".join(explanation(device)))


def _conductor(
    connect: str,
    state: Path | None,
    wait_s: float,
    namespace: str,
    key: Path | None,
    *,
    again: bool,
) -> Target:
    """The conductor to work for; the one of a state folder may still be on its way.

    ``again``: whoever started this starts it again while it is unfinished.
    """
    from twin.fabric.discovery import await_conductor, await_endpoint, choose_target
    from twin.fabric.keys.roles import Role

    if state is not None and not connect:
        return await_conductor(state, wait_s, Role.worker, key)
    target = choose_target(connect, None, namespace, key, Role.worker)
    if wait_s:
        try:
            await_endpoint(target, wait_s)
        except UnreachableError as error:
            if not again:
                raise
            # Cases may be left: a conductor may take longer to come than this waits.
            raise UnfinishedError(f"{error}; whoever started this may start it again") from None
    return target


@app.command()
def reenact(
    attempt: Annotated[
        Path, typer.Argument(help="Folder of an attempt with interventions, and their journal.")
    ],
    device: Device = "cpu",
    slots: Annotated[
        int | None, typer.Option(min=1, max=4096, help="Slots of the rig; default: as it had.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Keep the new attempt's files below this folder.")
    ] = None,
) -> None:
    """Run an attempt with interventions again from its journal; exits 1 if its KPIs differ."""
    from twin.worker.reenact import reenact

    raise typer.Exit(reenact(attempt, device, slots, out))


@app.command()
def judge(
    folder: Annotated[
        Path | None, typer.Argument(help="Campaign folder, e.g. runs/aeb-demo.")
    ] = None,
    attempt: Annotated[
        list[str] | None,
        typer.Option(help="Only this one, e.g. cases/NAME/attempt-1; repeatable."),
    ] = None,
    claims: Annotated[
        bool, typer.Option("--claims", hidden=True, help="Claims stand on standard input.")
    ] = False,
    output: OutputOption = Output.human,
) -> None:
    """Compute verdicts and scalars of committed attempts again, from their files; writes nothing.

    Exit code 3: they are not those that were committed.
    """
    from twin.kpi.judge_command import follow, judge_folder

    if claims:
        raise typer.Exit(follow())
    if folder is None:
        raise UsageError("judge: give a campaign folder, e.g. runs/aeb-demo")
    raise typer.Exit(judge_folder(folder, attempt or [], as_json=output is Output.json))


DrawnOption = Annotated[
    list[str] | None,
    typer.Option(
        help="Draw what a sensor sees as points, repeatable: radar, or with keys of its section "
        "as radar:profile=corner."
    ),
]
ScenarioOption = Annotated[
    str,
    typer.Option(
        help="Scenario file, or a shipped scenario, instead of a scene; all: every shipped one, "
        "shortly before its ego would touch somebody."
    ),
]


@app.command()
def snapshot(
    out: Annotated[Path, typer.Option(help="File to write, .png or .jpg.")] = Path("snapshot.png"),
    weather: Annotated[
        list[str] | None,
        typer.Option(help="Preset or custom weather, repeatable; default: all of them."),
    ] = None,
    time: Annotated[
        list[str] | None, typer.Option(help="Local time HH:MM, repeatable; default: eight hours.")
    ] = None,
    custom: Annotated[
        list[str] | None,
        typer.Option(
            help="A weather of one's own, repeatable: NAME:KEY=NUMBER,... with the intensities "
            "cloud, fog, rain, snow and wind from 0 to 1, as in sleet:rain=0.4,snow=0.3."
        ),
    ] = None,
    family: Annotated[str, typer.Option(help="Weather: physical or autodrive.")] = "physical",
    sun: Annotated[str, typer.Option(help="almanac, or autodrive: overhead at noon.")] = "almanac",
    date: Annotated[str, typer.Option(help="Day of sun and moon, YYYY-MM-DD.")] = "2025-03-20",
    ev100: Annotated[
        float | None, typer.Option(help="Fixed exposure value at ISO 100; default: automatic.")
    ] = None,
    scene: Annotated[str, typer.Option(help="Shipped scene, or a scene file.")] = "downtown",
    road: Annotated[str, typer.Option(help="OpenDRIVE file instead of a scene.")] = "",
    scenario: ScenarioOption = "",
    at_s: Annotated[
        float | None,
        typer.Option(min=0.0, max=3600.0, help="Time of the scenario [s]; default: its beginning."),
    ] = None,
    vehicle: Annotated[str, typer.Option(help="Shipped vehicle, or a vehicle file.")] = "opencav",
    distance: Annotated[float, typer.Option(help="Distance to the obstacle [m].")] = 25.0,
    at_m: Annotated[
        float | None, typer.Option(help="Stand so far along the lane instead [m].")
    ] = None,
    width: Annotated[int, typer.Option(help="Width of one picture [px].")] = 320,
    sensor: DrawnOption = None,
    device: Device = "cpu",
) -> None:
    """Render a street, road or scenario in several weathers and hours as one contact sheet.

    `twin snapshot --scenario my-cut-in.yaml --at-s 6 --weather clear --time 12:00 --width 960` is
    one picture of what the ego sees then, if nobody drives it otherwise.
    """
    from twin.snapshot import SheetRequest, write_sheet

    request = SheetRequest(
        weathers=tuple(weather or ()),
        times=tuple(time or ()),
        custom=tuple(custom or ()),
        environment={"family": family, "sun": sun, "date": date, "exposure_ev100": ev100},
        scene=scene,
        road=road,
        scenario=scenario,
        at_s=at_s,
        vehicle=vehicle,
        distance_m=distance,
        at_m=at_m,
        width_px=width,
        device=device,
        sensors=tuple(sensor or ()),
    )
    try:
        with bars():
            write_sheet(out, request)
    except ValueError as error:
        raise UsageError(str(error)) from None
    print(out)


@app.command()
def dataset(
    out: OutArgument,
    count: CountOption = None,
    seed: SeedOption = None,
    size: SizeOption = None,
    file_format: FileFormatOption = None,
    quality: QualityOption = None,
    scene: SceneOption = None,
    other_scene: OtherSceneOption = None,
    vehicle: VehicleOption = None,
    camera: CameraOption = None,
    cameras: CamerasOption = None,
    split_shares: SplitSharesOption = None,
    streets: StreetsOption = None,
    rule: RuleOption = None,
    jobs: JobsOption = None,
    slots: BatchOption = None,
    preview: PreviewOption = None,
    device: Device = "cpu",
    output: OutputOption = Output.human,
) -> None:
    """Render labelled images for detectors into a folder, or go on where it was stopped.

    On a folder that is there, options left away are what it was begun with. Ends with a table of
    what the dataset holds.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    from twin.dataset.command import DatasetRequest, show_dataset

    plain = {"count": count, "seed": seed, "format": file_format, "quality": quality}
    plain |= {"scene": scene, "other_scene": other_scene, "vehicle": vehicle}
    plain |= {"camera": camera, "cameras": cameras}
    request = DatasetRequest(
        out=out,
        plain=plain,
        size=size,
        split_shares=split_shares,
        streets=streets,
        rules=tuple(rule or ()),
        slots=slots,
        jobs=jobs,
        device=device,
        preview=preview,
    )
    show_dataset(request, as_json=output is Output.json)


@app.command()
def memory(
    slots: Annotated[int, typer.Option(min=1, help="Cases at once.")] = 256,
    camera: Annotated[
        list[str] | None,
        typer.Option(help="A camera of the vehicle, repeatable; default: front_right."),
    ] = None,
    width: Annotated[int, typer.Option(help="Width of their pictures [px].")] = 640,
    height: Annotated[int, typer.Option(help="Height of their pictures [px].")] = 360,
    effect: Annotated[list[str] | None, typer.Option(help="An effect, or all; repeatable.")] = None,
    image: Annotated[
        list[str] | None, typer.Option(help="A further picture, e.g. depth; repeatable.")
    ] = None,
    lidar: Annotated[
        list[str] | None, typer.Option(help="A lidar of the vehicle, repeatable.")
    ] = None,
    scene: Annotated[str, typer.Option(help="Shipped scene, or a scene file.")] = "downtown",
    vehicle: Annotated[str, typer.Option(help="Shipped vehicle, or a vehicle file.")] = "opencav",
    device: Device = "cpu",
    campaign: Annotated[
        str,
        typer.Option(
            help="Of the rigs and networks of this campaign file instead; -: standard input."
        ),
    ] = "",
    case: Annotated[
        str, typer.Option(hidden=True, help="Of the rig of this case, JSON on standard input: -.")
    ] = "",
    free_gb: Annotated[
        float | None,
        typer.Option(
            min=0, max=1e6, help="With --campaign: free memory, instead of the device's [GB]."
        ),
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Print what a rig's cameras and lidars take of a GPU, and how many slots fit on one.

    `twin memory --camera front_left --camera front_right --lidar roof --device cuda:0`
    """
    from twin.rig.memory import show_memory, show_memory_of, show_memory_of_case

    if case == "-":
        show_memory_of_case(sys.stdin.buffer.read(), slots, device, as_json=output is Output.json)
        return
    if campaign:
        show_memory_of(campaign, slots, device, free_gb, as_json=output is Output.json)
        return
    show_memory(
        slots,
        camera or ["front_right"],
        (width, height),
        effect or [],
        image or [],
        lidar or [],
        scene,
        vehicle,
        device,
        as_json=output is Output.json,
    )


def main() -> None:
    """Entry point."""
    run(app, "twin")
