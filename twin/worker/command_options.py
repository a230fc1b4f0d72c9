"""Options of the command ``twin worker``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from schemas.escape import escape
from schemas.sections.view_mode import ViewMode
from schemas.wire.site_name import SITE_PATTERN
from twin.base.cli import SECONDS_MAX, duration
from twin.base.errors import UsageError
from twin.worker.allocation import WALLTIME_VARIABLE

ConnectOption = Annotated[str, typer.Option(help="The conductor's endpoint, e.g. tls/login1:7447.")]
StateOption = Annotated[
    Path | None,
    typer.Option(help="Or: the conductor's state folder, on a shared file system."),
]
WaitOption = Annotated[float, duration("Wait this long for a conductor that is to come [s].")]
SlotsOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=4096,
        help="Cases simulated together; default: 1 on the CPU, on a GPU 128, or as many as its "
        "free memory holds.",
    ),
]
CoresOption = Annotated[
    str, typer.Option(help="Processor cores for it and its rigs, as in 0-7,12; default: all.")
]
ExplainOption = Annotated[
    bool, typer.Option("--explain", help="Say how its frames would travel, and end.")
]
DriveListenOption = Annotated[
    str,
    typer.Option(help="Where simulators listen for stacks on other nodes; beyond loopback TLS."),
]
JoinDirOption = Annotated[
    str,
    typer.Option(help="Shared folder that tells `devkit host --join` of such simulators."),
]
ViewOption = Annotated[
    ViewMode | None,
    typer.Option(
        help="live: viewers may look; record: one .rrd per attempt beside its KPIs; "
        "default: as the campaign says."
    ),
]
UntilDoneOption = Annotated[bool, typer.Option("--until-done", help="Leave when no case is left.")]
StartedAgainOption = Annotated[
    bool,
    typer.Option(
        "--started-again",
        help="Somebody starts it again while cases are left: with some left, or where no conductor "
        "answers, it ends with 75.",
    ),
]
AwaySOption = Annotated[
    float | None,
    duration(
        "Leave when no conductor has answered for so long and no case runs; results are waited "
        "for as long again as their cases took, from their end; a conductor may be silent for 2 s "
        "between heartbeats; default: wait for it [s].",
    ),
]
DrainSOption = Annotated[float, duration("After SIGTERM, running cases may go on this long [s].")]
WalltimeSOption = Annotated[
    float | None,
    duration(
        "The allocation ends so long from now: only cases that fit are leased, and "
        "everything is given back before it; below 0: it is over [s].",
        least=-SECONDS_MAX,
        envvar=WALLTIME_VARIABLE,
    ),
]
MemoryGbOption = Annotated[
    float | None,
    typer.Option(min=0.1, max=1e6, help="Most memory of a rig; one that needs more is ended [GB]."),
]
TagOption = Annotated[
    list[str] | None,
    typer.Option(help="A word that campaigns may ask for (`requires.tags`); repeatable."),
]
SiteOption = Annotated[
    str,
    typer.Option(help="Cluster that this host belongs to, for reports over several; e.g. north."),
]
SpoolOption = Annotated[
    Path | None,
    typer.Option(help="Folder for results while the conductor is away; default STATE/spool."),
]


def checked_site(text: str) -> str:
    """``text``, which is the name of a site, or empty.

    Raises:
        UsageError: it is none.
    """
    if text and not re.fullmatch(SITE_PATTERN, text):
        raise UsageError(
            f"--site {escape(text, 80)}: allowed are 1 to 32 letters, digits and -, e.g. north"
        )
    return text
