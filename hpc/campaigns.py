"""Is this a campaign? The ``conductor`` command knows; it is asked as any user would ask it."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpc.commands import call
from twin.base.errors import EXIT_PASS, EXIT_USAGE, InfrastructureError, UsageError


@dataclass(frozen=True, slots=True)
class CampaignFacts:
    """What a job has to know about a campaign."""

    name: str
    """Name that a job can use: a shipped name, or a file's absolute path."""
    cases: tuple[str, ...]
    """Ids of the cases in file order."""
    deadline_s: float
    """Longest time without progress before an attempt is given up [s]."""
    remote_stacks: bool
    """Simulators and stacks run on different nodes."""
    records: bool = False
    """Whether attempts leave recordings, of the view or of what the stack saw."""
    drive_records: bool = False
    """Whether they leave what the stack saw, which no result store has."""
    files: tuple[str, ...] = ()
    """Files beside the campaign file that it names; none for a shipped campaign."""
    paths: tuple[str, ...] = ()
    """Absolute paths that its stack names; none for a shipped campaign."""
    commands: bool = False
    """Whether its stack is a command, which hosts on other nodes start only if they are told to."""


def checked(campaign: str) -> CampaignFacts:
    """Look at a campaign.

    Raises:
        UsageError: it is none; one line per mistake.
        InfrastructureError: the check itself did not work.
    """
    # With the repository of its stack: compute nodes may have no network.
    words = ("conductor", "validate", "--fetch", "--output", "json", "--", campaign)
    done = call(sys.executable, "-m", *words)
    if done.code == EXIT_USAGE and done.out:
        raise UsageError("\n".join(json.loads(done.out)["mistakes"]))
    if done.code != EXIT_PASS:
        raise InfrastructureError(f"{campaign}: `conductor validate` failed: {done.last_words}")
    answer: dict[str, Any] = json.loads(done.out)
    path = Path(campaign)
    # A shipped name stays one, also when a file in this folder happens to be called like it.
    is_file = path.is_file() and ("/" in campaign or path.suffix != "")
    return CampaignFacts(
        name=str(path.absolute()) if is_file else campaign,
        cases=tuple(answer["cases"]),
        deadline_s=answer["deadline_s"],
        remote_stacks=answer["placement"] == "node",
        records=answer["records"],
        drive_records=answer["drive_records"],
        files=tuple(answer["files"]) if is_file else (),
        paths=tuple(answer["paths"]) if is_file else (),
        commands=answer["commands"],
    )
