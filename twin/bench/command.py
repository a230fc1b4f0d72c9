"""``twin bench``: how fast parts of the simulator are."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError
from twin.base.progress import bars

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Measure how fast parts of the simulator are."
)


@app.callback()
def _root() -> None:
    """Measure how fast parts of the simulator are."""


@app.command("all")
def every(
    device: Annotated[str, typer.Option(help="Where to measure: cpu or cuda:N.")] = "cpu",
    only: Annotated[
        str, typer.Option(help="Some of the benches, with commas, such as vehicle,lidar.")
    ] = "",
    history: Annotated[Path, typer.Option(help="File to which the figures are added.")] = Path(
        "runs/benches.jsonl"
    ),
    page: Annotated[Path, typer.Option(help="Page of trends to write.")] = Path(
        "runs/benches.html"
    ),
    label: Annotated[str, typer.Option(help="Name of this run, such as a commit.")] = "",
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 if a target fell.")] = False,
) -> None:
    """All benches one after the other, held against earlier runs on the same kind of machine.

    A target that is 10 % or more worse than the median of its last 20 runs has fallen. The page has
    a table and a plot of every target. A quarter of an hour on two cores; on an idle machine, or
    figures mean little. Exit code 1 also if a bench gave no figures.
    """
    from twin.bench.trends.command import bench_all

    as_json = output is Output.json
    bench_all(device, only, history, page, label, as_json=as_json, check=check)


@app.command()
def vehicle(
    device: Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")] = "cpu",
    vehicles: Annotated[
        int, typer.Option(min=0, help="Cars, one per slot; 0: 64 on a CPU, 16384 on a GPU.")
    ] = 0,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below the target.")] = False,
) -> None:
    """Vehicle substeps of 2 ms per second, and the ratio to an independent single-track model.

    The target is 150,000/s on one CPU core at 64 vehicles and 100 million/s on an H200 at 16,384.
    The other model is that of commonroad-vehicle-models, if it is installed.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import warp as wp

    from twin.bench.vehicle import ORACLE, VEHICLES, measure

    if device not in {str(d) for d in wp.get_devices()}:
        known = ", ".join(str(d) for d in wp.get_devices())
        raise UsageError(f"device '{device}': not here; allowed: {known}")
    with bars():
        figures = measure(device, vehicles or VEHICLES[device.partition(":")[0]])
    missed = figures.substeps_per_s < figures.target
    if output is Output.json:
        result = {
            "device": figures.device,
            "vehicles": figures.vehicles,
            "substeps_per_s": figures.substeps_per_s,
            "target_substeps_per_s": figures.target,
            "oracle_steps_per_s": figures.oracle_steps_per_s,
            "ratio": figures.ratio,
        }
        print(json.dumps(result, indent=1))
    else:
        rate = f"{figures.substeps_per_s:,.0f} vehicle substeps/s"
        print(
            f"{rate} on {figures.device}, {figures.vehicles} vehicles "
            f"(target {figures.target:,.0f})"
        )
        if figures.ratio is None:
            print(f"no ratio: {ORACLE} is not installed (pip install {ORACLE}==3.0.2)")
        else:
            print(
                f"{figures.ratio:,.0f} times the {figures.oracle_steps_per_s:,.0f} single-track "
                f"Runge-Kutta steps/s of {ORACLE} in the same run"
            )
    if check and missed:
        print(f"twin: below the target of {figures.target:,.0f} substeps/s", file=sys.stderr)
        raise typer.Exit(1)


@app.command()
def camera(
    device: Annotated[str, typer.Option(help="Where to render: cpu or cuda:N.")] = "cpu",
    slots: Annotated[int, typer.Option(min=0, help="Views; 0: 1 on a CPU, 256 on a GPU.")] = 0,
    width: Annotated[int, typer.Option(min=0, help="Image width [px]; 0: 320 or 640.")] = 0,
    height: Annotated[int, typer.Option(min=0, help="Image height [px]; 0: 180 or 360.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer rounds, no peer.")] = False,
    variants: Annotated[
        bool, typer.Option("--variants", help="Time alternatives of the kernels instead.")
    ] = False,
    ablate: Annotated[
        bool, typer.Option("--ablate", help="Time the kernels with parts left out instead.")
    ] = False,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below a target.")] = False,
) -> None:
    """Camera frames per second, and the ratio to newton's camera on the same triangles and views.

    Targets: 110 frames/s of 320x180 on one CPU core; on an H200 12,000 of 640x360 with 256 slots,
    6,000 with every effect, 1,500 of 1920x1080 with 32 slots, and 1.3 times newton.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import warp as wp

    from schemas.sections.camera import Camera
    from schemas.validation import convert_all
    from twin.bench import camera as bench

    if device not in {str(d) for d in wp.get_devices()}:
        known = ", ".join(str(d) for d in wp.get_devices())
        raise UsageError(f"device '{device}': not here; allowed: {known}")
    usual = bench.SIZES[device.partition(":")[0]]
    size = bench.Size(slots or usual.slots, width or usual.width, height or usual.height)
    _, mistakes = convert_all({"width": size.width, "height": size.height}, Camera)
    if mistakes:
        raise UsageError("\n".join(mistake.line("picture") for mistake in mistakes))
    if variants or ablate:
        from twin.bench import camera_variants

        look = camera_variants.ablate if ablate else camera_variants.time_variants
        print(json.dumps(look(device, size), indent=1))
        return
    with bars():
        figures = bench.measure(device, size, peer=not quick, rounds=2 if quick else 5)
    _tell(bench, figures, output, check=check)


@app.command()
def lidar(
    device: Annotated[str, typer.Option(help="Where to cast: cpu or cuda:N.")] = "cpu",
    slots: Annotated[int, typer.Option(min=0, help="Sensors; 0: 8 on a CPU, 256 on a GPU.")] = 0,
    profile: Annotated[
        str, typer.Option(help="Shipped LiDAR profile, or the path of a file.")
    ] = "spinning_32",
    scene: Annotated[str, typer.Option(help="Shipped scene, or the path of a file.")] = "downtown",
    variants: Annotated[
        bool, typer.Option("--variants", help="Time shapes of the tiles instead.")
    ] = False,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below a target.")] = False,
) -> None:
    """LiDAR rays per second, and the ratio to newton's ranges on the same triangles and rays.

    Targets, with intensity, noise, weather and motion: 6 million/s on one CPU core, and bare ranges
    1.8 times newton's; 3 billion/s on an H200 with 256 slots of 32 x 1024 rays.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import warp as wp

    from twin.bench import lidar as bench

    if device not in {str(d) for d in wp.get_devices()}:
        known = ", ".join(str(d) for d in wp.get_devices())
        raise UsageError(f"device '{device}': not here; allowed: {known}")
    count = slots or bench.SLOTS[device.partition(":")[0]]
    try:
        if variants:
            with bars():
                found = bench.time_tiles(device, count, profile, scene)
            print(json.dumps(found, indent=1))
            return
        with bars():
            figures = bench.measure(device, count, profile, scene)
    except ValueError as error:
        raise UsageError(str(error)) from None
    _tell(bench, figures, output, check=check)


@app.command()
def radar(
    device: Annotated[str, typer.Option(help="Where to measure: cpu or cuda:N.")] = "cpu",
    slots: Annotated[int, typer.Option(min=0, help="Radars; 0: 1 on a CPU, 256 on a GPU.")] = 0,
    profile: Annotated[
        str, typer.Option(help="Shipped radar profile, or the path of a file.")
    ] = "long_range",
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below the target.")] = False,
) -> None:
    """Radar measurements per second, with noise, rain, clutter and second ways over the road.

    Targets: 10 per second on one CPU core; 2,000 on an H200 with 256 slots.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import warp as wp

    from twin.bench import radar as bench

    if device not in {str(d) for d in wp.get_devices()}:
        known = ", ".join(str(d) for d in wp.get_devices())
        raise UsageError(f"device '{device}': not here; allowed: {known}")
    try:
        with bars():
            figures = bench.measure(device, slots or bench.SLOTS[device.partition(":")[0]], profile)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if output is Output.json:
        print(json.dumps({**asdict(figures), "target": figures.target}, indent=1))
    else:
        print(
            f"{figures.frames_per_s:,.1f} radar measurements/s on {figures.device}, "
            f"{figures.slots} slots of {figures.profile} (target {figures.target:,.0f}); "
            f"{figures.detections:.1f} detections each, bytes {figures.digest[:8]}"
        )
    if check and figures.frames_per_s < figures.target:
        print(f"twin: below the target of {figures.target:,.0f} measurements/s", file=sys.stderr)
        raise typer.Exit(1)


@app.command()
def storyboard(
    device: Annotated[str, typer.Option(help="Where to play: cpu or cuda:N.")] = "cpu",
    slots: Annotated[int, typer.Option(min=0, help="Slots; 0: 1 on a CPU, 256 on a GPU.")] = 0,
    actors: Annotated[int, typer.Option(min=1, max=64, help="Actors of a slot.")] = 16,
    quick: Annotated[bool, typer.Option("--quick", help="Only the steps.")] = False,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 above a target.")] = False,
) -> None:
    """Milliseconds of a step of storyboard programs with reacting actors, and camera frames per
    second with moving bodies beside standing ones.

    Targets: 0.3 ms with 256 slots of 16 actors on an H200; on one CPU core 10 % of the time that
    the loop of a shipped campaign takes; moving bodies slow the cameras by at most 10 %.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import warp as wp

    from twin.bench import storyboard as bench

    if device not in {str(d) for d in wp.get_devices()}:
        known = ", ".join(str(d) for d in wp.get_devices())
        raise UsageError(f"device '{device}': not here; allowed: {known}")
    with bars():
        figures = bench.measure(device, slots, actors, demo=not quick, cameras=not quick)
    _tell(bench, figures, output, check=check)


@app.command()
def drive(
    ticks: Annotated[int, typer.Option(min=10, help="Ticks of a round.")] = 1000,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below a target.")] = False,
) -> None:
    """Lockstep ticks per second of simulator and stack, beside the AutoDRIVE bridge.

    One slot, two pictures of 640x360 and 32 x 1024 points with every tick, nothing rendered, a
    stack that looks at nothing. Targets: 300 ticks/s, and 20 times the bridge in the same run.
    """
    from twin.bench import drive as bench

    with bars():
        figures = bench.measure(ticks)
    _tell(bench, figures, output, check=check)


@app.command()
def campaign(
    campaign: Annotated[str, typer.Argument(help="Shipped campaign or path of a file.")],
    slots: Annotated[
        str | None,
        typer.Option(
            help="Cases together per worker: one number, or several with commas; default: "
            "1,8,64,256, up to what the campaign's cases fill."
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")] = "cpu",
    cases: Annotated[
        int | None, typer.Option(min=1, help="Only so many cases, the first; default: all.")
    ] = None,
    workers: Annotated[str, typer.Option(help="As of `conductor run`.")] = "1",
    out: Annotated[
        Path | None, typer.Option(help="Keep the campaign folders here; default: nowhere.")
    ] = None,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below a target.")] = False,
) -> None:
    """A whole campaign by `conductor run`: cases per minute, and where the time goes.

    Shares are of the simulator's loop, from its first tick to its last: physics, render, inference,
    transport (frames to the host, Zenoh, the other process's wake-up), conductor (no case to run,
    orders) and host (Python of simulator and stack). Targets, with the last number of slots on a
    GPU: 10 ms of wall time per simulated second of a case from command to report, real-time factor
    100, GPU 85 %.
    """
    from twin.bench.campaign_command import show

    show(campaign, slots, device, cases, workers, out, as_text=output is Output.human, check=check)


@app.command()
def gym(
    campaign: Annotated[
        str, typer.Argument(help="Shipped campaign or path of a file.")
    ] = "lane-loop",
    envs: Annotated[
        int, typer.Option(min=0, max=4096, help="Environments; 0: 2 on a CPU, 256 on a GPU.")
    ] = 0,
    device: Annotated[str, typer.Option(help="Where to simulate: cpu or cuda:N.")] = "cpu",
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 below the target.")] = False,
) -> None:
    """Steps and camera frames per second of learning environments, and the ratio to a campaign.

    The campaign has the same sensors, and a stack that does nothing. Target on a GPU: 80 % of its
    camera frames per second.
    """
    import tempfile

    from twin.base.software import device_class

    device_class(device)  # refuses one that is not here
    from twin.gym import bench

    with tempfile.TemporaryDirectory(prefix="twin-bench-") as folder, bars() as told:
        count = envs or (256 if device.startswith("cuda") else 2)
        figures = bench.measure(campaign, count, device, Path(folder), partial(told, "cases"))
    _tell(bench, figures, output, check=check)


def _tell(bench: Any, figures: Any, output: Output, *, check: bool) -> None:
    """Print what ``bench`` has found; with --check, end with 1 below a target."""
    if output is Output.json:
        print(json.dumps(bench.as_json(figures), indent=1))
    else:
        print("\n".join(bench.lines(figures)))
    if check and figures.missed:
        print(f"twin: below target: {'; '.join(figures.missed)}", file=sys.stderr)
        raise typer.Exit(1)


@app.command()
def sandbox(
    campaign: Annotated[
        str, typer.Option(help="Shipped campaign to run with and without; empty: starts alone.")
    ] = "aeb-demo",
    rounds: Annotated[int, typer.Option(min=0, max=20, help="Runs of each kind.")] = 1,
    output: OutputOption = Output.human,
    check: Annotated[bool, typer.Option("--check", help="Exit 1 above a target.")] = False,
) -> None:
    """What the sandbox of stacks costs: at the start of a rig, and of a campaign's processor time.

    The targets are 50 ms and 2 %.
    """
    from dataclasses import asdict

    from twin.bench.sandbox import measure

    with bars():
        figures = measure(campaign, rounds)
    if output is Output.json:
        print(json.dumps({**asdict(figures), "missed": figures.missed}))
    else:
        print(
            f"start of a process: {figures.start_ms:+.1f} ms; "
            f"once per worker {figures.first_ms:.1f}"
        )
        if figures.campaign_percent is not None:
            print(f"{figures.campaign}: {figures.campaign_percent:+.1f} % of its processor time")
    if check and figures.missed:
        print(f"twin: missed: {'; '.join(figures.missed)}", file=sys.stderr)
        raise typer.Exit(1)
