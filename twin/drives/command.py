"""``twin replay-log``: a recorded drive becomes a scenario; `conductor replay-log` asks for it."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schemas.words import counted
from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError, storage_error

if TYPE_CHECKING:
    from twin.drives.drive import RecordedDrive
    from twin.drives.scenario import CutDrive

STEPS = 3
"""Steps that the bar counts: reading, cutting and writing, checking."""


def replay_log(
    file: Annotated[Path, typer.Argument(help="An MCAP file of ROS 2, or a rosbag2 folder.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder to write; default: its name.")
    ] = None,
    from_s: Annotated[
        float, typer.Option("--from", min=0.0, max=86_400.0, help="Begin then [s].")
    ] = 0.0,
    to_s: Annotated[
        float | None,
        typer.Option("--to", min=0.0, max=86_400.0, help="End then [s]; default: with the ego."),
    ] = None,
    ego: Annotated[str, typer.Option(help="Topic of odometry, or a frame of /tf.")] = "",
    objects: Annotated[str, typer.Option(help="Topic of objects, or beginning of frames.")] = "",
    road: Annotated[str, typer.Option(help="A shipped road, or an OpenDRIVE file.")] = "",
    range_m: Annotated[
        float, typer.Option("--range", min=1.0, max=1000.0, help="Only what comes so near [m].")
    ] = 120.0,
    output: OutputOption = Output.human,
) -> None:
    """Make a scenario and a campaign of a recorded drive."""
    from twin.base.progress import progress
    from twin.drives.apart import drive_apart, note_of_reading
    from twin.drives.check import check_scenario
    from twin.drives.drive import DriveQuestion
    from twin.drives.scenario import DriveCut, cut_drive
    from twin.drives.writing import SCENARIO_FILE, scenario_name, write_drive

    folder = out or Path(scenario_name(file))
    if folder.exists():
        raise UsageError(f"{folder}: it exists; give a folder that does not, with -o")
    if to_s is not None and to_s <= from_s:
        raise UsageError(f"--to {to_s:g}: it must be after --from {from_s:g}")
    with progress("replay-log", "importing", "steps") as told:
        if note := note_of_reading():
            told.say(note)
        told(0, STEPS)
        drive = drive_apart(file, DriveQuestion(ego=ego, objects=objects))
        told(1, STEPS)
        cut = cut_drive(drive, DriveCut(from_s, to_s, range_m, moved=not road))
        if road.endswith(".xodr"):
            road = str(Path(road).absolute())
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        try:
            try:
                files = write_drive(folder, scenario_name(file), drive, cut, road)
            except OSError as error:
                raise storage_error(error, str(folder)) from None
            told(2, STEPS)
            check_scenario(folder / SCENARIO_FILE)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)  # the same command may be given again
            raise
        told(STEPS, STEPS)
    _say(folder, files, drive, cut, as_json=output is Output.json)


def _say(
    folder: Path, files: list[Path], drive: RecordedDrive, cut: CutDrive, *, as_json: bool
) -> None:
    notes = [*drive.notes, *cut.notes]
    if as_json:
        answer = {
            "folder": str(folder),
            "files": [str(path) for path in files],
            "ego": drive.ego_source,
            "objects": drive.objects_source,
            "frame": drive.frame,
            "actors": {actor.name: actor.source for actor in cut.actors},
            "duration_s": cut.duration_s,
            "origin_m": cut.origin_m,
            "notes": notes,
        }
        print(json.dumps(answer))
        return
    for line in notes:
        print(line, file=sys.stderr)
    source = f" of {drive.objects_source}" if drive.objects_source else ""
    actors = counted(len(cut.actors), "actor") + source
    print(f"{folder}: {cut.duration_s:.2f} s, ego of {drive.ego_source}, {actors}")
    print(f"next: conductor run {folder / files[1].name}")
