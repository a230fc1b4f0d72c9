"""``twin validate``: does what is simulated behave as it should."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption
from twin.base.errors import EXIT_PASS, EXIT_USAGE, UsageError
from twin.base.progress import bars

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Check scene and road files, and compare the simulator with references.",
)


@app.callback()
def _root() -> None:
    """Check scene and road files, and compare the simulator with references."""


@app.command()
def scene(
    name: Annotated[
        str, typer.Argument(help="A shipped scene, or the path of a scene file.")
    ] = "downtown",
    output: OutputOption = Output.human,
) -> None:
    """Check a scene file: its keys, the scripts of its objects, vehicles that overlap.

    Exit code 2: something is wrong with it.
    """
    from twin.validate.scene_check import Variant, check_scenes

    mistakes, notes = check_scenes([Variant(name, {})])
    for note in notes:
        print(note, file=sys.stderr)
    if output is Output.json:
        print(json.dumps({"valid": not mistakes, "mistakes": mistakes, "notes": notes}))
    elif mistakes:
        raise UsageError("\n".join(mistakes))
    else:
        print(f"{name}: valid")
    raise typer.Exit(EXIT_USAGE if mistakes else EXIT_PASS)


@app.command()
def scenario(
    file: Annotated[
        Path,
        typer.Argument(
            help="An OpenSCENARIO XML file (.xosc), 1.0 to 1.3; a scenario file (.yaml); or the "
            "name of a shipped scenario."
        ),
    ],
    distribution: Annotated[
        Path | None, typer.Option(help="A parameter distribution file that varies a .xosc.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Play it, and draw lanes, ways and events from above: a .png or .svg."),
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Check a scenario with the files it uses, and say what it does.

    Prints entities, events with what they wait for, and when the scenario ends; of an OpenSCENARIO
    file also parameters and catalogs, for the first permutation of a distribution. Notes about what
    has no effect go to stderr.

    `twin validate scenario cut-in --picture cut-in.png` also plays it, with nobody at the ego's
    wheel, and draws what happened.

    Exit code 2: a line for everything that is wrong or cannot be played, with file and line number
    or key.
    """
    from twin.road.opendrive.apart import notes_of_reading
    from twin.validate.scenario_check import check_scenario, draw_scenario

    mistakes: list[str] = []
    lines: list[str] = []
    notes: list[str] = []
    try:
        lines, notes = check_scenario(file, distribution)
        if picture is not None:
            draw_scenario(file, distribution, picture)
    except ValueError as error:
        mistakes = str(error).splitlines()
    notes += notes_of_reading()
    if output is not Output.json:
        for note in notes:
            print(f"note: {note}", file=sys.stderr)
    if output is Output.json:
        words = {"valid": not mistakes, "mistakes": mistakes, "notes": notes, "outline": lines}
        print(json.dumps(words))
    elif mistakes:
        raise UsageError("\n".join(mistakes))
    else:
        print("\n".join([*lines, *([f"picture: {picture}"] if picture is not None else [])]))
    raise typer.Exit(EXIT_USAGE if mistakes else EXIT_PASS)


@app.command()
def road(
    file: Annotated[Path, typer.Argument(help="An OpenDRIVE file (.xodr), version 1.4 to 1.8.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for roads.png: all lanes and marks from above.")
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Read an OpenDRIVE file, and say what is in it.

    The table has a line per road: length, width of all lanes, tightest radius, heights, steepest
    slope, superelevation, and lanes by type. Below it stands every place where pieces of a road, or
    ends of linked roads, are more than 1 cm or 0.1 degrees apart: vehicles would jump there. What
    the file has and is left out is a line each.

    `twin validate road town.xodr --out look` also draws look/roads.png.

    Exit code 2: the file is broken, or needs what is not supported; the line names file, line and
    element. Reading needs lxml: pip install 'drivetwin[scenarios]'.
    """
    from rich.console import Console

    from twin.base.errors import storage_error
    from twin.road.opendrive.apart import network_apart, notes_of_reading
    from twin.road.opendrive.road_map import RoadMap
    from twin.validate import road_check

    try:
        roads = RoadMap(network_apart(file))
    except ValueError as error:
        raise UsageError(str(error)) from None
    for note in notes_of_reading():
        print(note, file=sys.stderr)
    check = road_check.check_roads(roads)
    if output is Output.json:
        print(json.dumps(road_check.to_json(check), indent=1))
    else:
        width = None if sys.stdout.isatty() else 140
        Console(width=width, highlight=False).print(road_check.to_table(check))
    if out is not None:
        from twin.validate.road_picture import write_picture

        try:
            path = write_picture(out, roads)
        except OSError as error:
            raise storage_error(error, str(out)) from None
        print(path, file=sys.stderr if output is Output.json else sys.stdout)


@app.command(hidden=True)
def campaign() -> None:
    """Say what is wrong with the scenes, objects and plug-ins of a campaign.

    Reads a campaign as JSON from standard input, and writes JSON: {"mistakes": [{"path", "message"}
    ...], "notes": [...]}. The exit code is 0 either way; `conductor` asks this before it leases a
    case.
    """
    import msgspec

    from schemas.campaign import Campaign
    from twin.validate.campaign_check import check_campaign

    try:
        given = msgspec.json.decode(sys.stdin.buffer.read(), type=Campaign)
    except msgspec.DecodeError as error:
        raise UsageError(f"standard input: {error}") from None
    mistakes, notes = check_campaign(given)
    told = [{"path": mistake.path, "message": mistake.message} for mistake in mistakes]
    print(json.dumps({"mistakes": told, "notes": notes}))


@app.command()
def vehicle(
    name: Annotated[str, typer.Argument(help="A shipped vehicle, or the path of a vehicle file.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for a page with the table and all plots.")
    ] = None,
    output: OutputOption = Output.human,
) -> None:
    """Drive a vehicle through its manoeuvres: braking, accelerating, cornering, heaving.

    Every figure is compared with a closed form, a regulation, or what the vehicle's file cites.
    Exit code 1: one is out of tolerance.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels
    if out is not None:
        from twin.validate import page  # what is missing for it is said before minutes of driving

    from rich.console import Console

    from twin.validate import table
    from twin.vehicle.vehicle_file import load_vehicle

    try:
        car = load_vehicle(name)
        with bars():
            checks = table.validate(car)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if output is Output.json:
        print(json.dumps(table.to_json(car, checks), indent=1))
    else:
        width = None if sys.stdout.isatty() else 140
        Console(width=width).print(table.to_table(car, checks))
    if out is not None:
        path = page.write(out, car, checks)
        print(path, file=sys.stderr if output is Output.json else sys.stdout)
    raise typer.Exit(0 if all(check.passed for check in checks) else 1)


@app.command()
def lidar(
    name: Annotated[str, typer.Argument(help="A shipped LiDAR profile, or the path of a file.")],
    output: OutputOption = Output.human,
) -> None:
    """Put a LiDAR into rain, snow and fog, and compare what it sees with what was published.

    It sweeps the open air, and walls 50 m away, on the CPU. Sources: docs/precipitation.md.
    Exit code 1: a figure is outside the published range.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    from rich.console import Console

    from twin.sensors.lidar.profile_file import load_lidar_profile
    from twin.validate import precipitation

    try:
        profile = load_lidar_profile(name)
    except ValueError as error:
        raise UsageError(str(error)) from None
    found = precipitation.figures(profile)
    rows = precipitation.checks(found, profile)
    if output is Output.json:
        print(json.dumps(precipitation.to_json(found, rows), indent=1))
    else:
        console = Console(width=None if sys.stdout.isatty() else 140)
        for table in precipitation.to_tables(found, rows):
            console.print(table)
    raise typer.Exit(0 if all(row.passed for row in rows) else 1)


@app.command()
def radar(
    name: Annotated[
        str, typer.Argument(help="A shipped radar profile, or the path of a file.")
    ] = "long_range",
    output: OutputOption = Output.human,
) -> None:
    """Compare a radar with closed forms: cross sections, bias, false alarms, rain, resolution.

    It measures single targets and noise, on the CPU. Exit code 1: a figure is beyond its limit.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    from rich.console import Console

    from twin.sensors.radar.profile import load_radar_profile
    from twin.validate import radar_truth

    try:
        profile = load_radar_profile(name)
    except ValueError as error:
        raise UsageError(str(error)) from None
    rows = radar_truth.truth_rows(profile)
    if output is Output.json:
        print(json.dumps(radar_truth.to_json(profile, rows), indent=1))
    else:
        width = None if sys.stdout.isatty() else 140
        Console(width=width).print(radar_truth.to_table(profile, rows))
    raise typer.Exit(0 if all(row.passed for row in rows) else 1)
