"""Commands that act on a conductor that serves: explain, pause, resume, cancel, retry, drain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from conductor.commands.client import ConductorClient
from schemas.words import counted
from twin.fabric.connection_options import InsecureOption, KeyOption
from twin.fabric.keys.roles import Role

Connect = Annotated[str, typer.Option(help="The conductor's endpoint, e.g. tls/login1:7447.")]
State = Annotated[
    Path | None, typer.Option(help="Or: the conductor's state folder (holds conductor.json).")
]
Namespace = Annotated[str, typer.Option(help="Prefix of every key of this fabric.")]
CampaignName = Annotated[str, typer.Argument(help="Name of the campaign.")]
CaseName = Annotated[str, typer.Argument(help="One case of it; default: all.")]

Action = Literal["pause", "resume", "cancel", "retry"]

ACTIONS: dict[Action, str] = {
    "pause": "Lease no more of a campaign or case; what runs goes on.",
    "resume": "Lease a paused campaign or case again.",
    "cancel": "End what has not ended; outcomes that are there stay.",
    "retry": "Run cases that are unresolved or cancelled once more.",
}
"""What may be done to a campaign or one of its cases: command -> help."""


def add_commands(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command()(explain)
    for action, text in ACTIONS.items():
        app.command(action, help=text)(_command(action))
    app.command()(drain)


def explain(
    campaign: CampaignName,
    case: Annotated[str, typer.Argument(help="The case.")],
    connect: Connect = "",
    state: State = None,
    namespace: Namespace = "twin",
    key: KeyOption = None,
    _insecure: InsecureOption = False,
) -> None:
    """Say why a case waits, runs or ended."""
    with ConductorClient(connect, state, namespace, key, Role.viewer) as client:
        for line in client.explain(campaign, case):
            print(line)


def drain(
    worker: Annotated[str, typer.Argument(help="The worker, as `conductor status` names it.")],
    connect: Connect = "",
    state: State = None,
    namespace: Namespace = "twin",
    key: KeyOption = None,
    _insecure: InsecureOption = False,
) -> None:
    """Let a worker give its cases back and leave."""
    with ConductorClient(connect, state, namespace, key) as client:
        client.control("drain", worker=worker)
    print(f"{worker}: draining")


def _command(action: Action) -> Callable[..., None]:
    """The command of an action on a campaign or one of its cases."""

    def act(
        campaign: CampaignName,
        case: CaseName = "",
        connect: Connect = "",
        state: State = None,
        namespace: Namespace = "twin",
        key: KeyOption = None,
        _insecure: InsecureOption = False,
    ) -> None:
        with ConductorClient(connect, state, namespace, key) as client:
            changed = client.control(action, campaign=campaign, case=case)
        print(f"{action} {campaign}{f' {case}' if case else ''}: {counted(changed, 'case')}")

    return act
