"""``conductor replay-log``: a recorded drive becomes a scenario and a campaign."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.base.cli import Output, OutputOption


def replay_log_command(
    file: Annotated[Path, typer.Argument(help="An MCAP file of ROS 2, or a rosbag2 folder.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder to write; default: the name of the recording."),
    ] = None,
    from_s: Annotated[
        float,
        typer.Option(
            "--from", min=0.0, max=86_400.0, help="The stack has the ego from this second on [s]."
        ),
    ] = 0.0,
    to_s: Annotated[
        float | None,
        typer.Option(
            "--to", min=0.0, max=86_400.0, help="The scenario ends then [s]; default: with the ego."
        ),
    ] = None,
    ego: Annotated[
        str,
        typer.Option(help="Topic of nav_msgs/Odometry, or a frame of /tf; default: chosen."),
    ] = "",
    objects: Annotated[
        str,
        typer.Option(
            help="Topic of objects with ids (vision_msgs/Detection3DArray, Autoware's tracked or "
            "predicted objects), or how names of frames begin, as npc_*; default: chosen."
        ),
    ] = "",
    road: Annotated[
        str,
        typer.Option(
            help="A shipped road, or an OpenDRIVE file in the recording's coordinates; default: a "
            "road along the ego's way."
        ),
    ] = "",
    range_m: Annotated[
        float,
        typer.Option(
            "--range", min=1.0, max=1000.0, help="Objects that never come nearer stay out [m]."
        ),
    ] = 120.0,
    output: OutputOption = Output.human,
) -> None:
    """Make a scenario and a campaign of a recorded drive (ROS 2, MCAP or rosbag2).

    `conductor replay-log drive.mcap -o drive --from 12`, then `conductor run drive/campaign.yaml`:
    the scenario begins 12 s into the recording, with the ego where it was and as fast as it was;
    from then on the stack drives it. All others go where they were recorded, whatever the ego
    does, and are there as long as they were seen.

    The folder has scenario.yaml (poses of everybody, to be changed by hand), road.xodr unless
    --road names one, and campaign.yaml. The recording is read by a process in the sandbox of
    stacks; what it holds, and what was left out, is said.

    Exit code 2: it is no such recording, or has no ego; the line says which topics are in it.
    Needs rosbags: pip install 'drivetwin[ros2,scenarios]'.
    """
    words = [str(file), "--from", str(from_s), "--range", str(range_m), "--output", output.value]
    for option, value in (("--out", out), ("--to", to_s)):
        words += [option, str(value)] if value is not None else []
    for option, text in (("--ego", ego), ("--objects", objects), ("--road", road)):
        words += [option, text] if text else []
    # Files of scenarios are the business of ``twin``, which is asked as any user would ask it.
    done = subprocess.run([sys.executable, "-m", "twin", "replay-log", *words], check=False)
    raise typer.Exit(done.returncode)
