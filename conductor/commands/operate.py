"""Commands that act on a conductor that serves: explain, pause, resume, cancel, retry, drain."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import typer

from schemas.words import counted
from twin.base.option_record import with_options
from twin.fabric.connection_options import ConductorOptions
from twin.fabric.keys.roles import Role

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
    app.command()(with_options(explain))
    for action, text in ACTIONS.items():
        app.command(action, help=text)(with_options(_command(action)))
    app.command()(with_options(drain))


def explain(
    campaign: CampaignName,
    case: Annotated[str, typer.Argument(help="The case.")],
    conductor: ConductorOptions = ConductorOptions(),
) -> None:
    """Say why a case waits, runs or ended."""
    from conductor.commands.client import client_of

    with client_of(conductor, Role.viewer) as client:
        for line in client.explain(campaign, case):
            print(line)


def drain(
    worker: Annotated[str, typer.Argument(help="The worker, as `conductor status` names it.")],
    conductor: ConductorOptions = ConductorOptions(),
) -> None:
    """Let a worker give its cases back and leave."""
    from conductor.commands.client import client_of

    with client_of(conductor) as client:
        client.control("drain", worker=worker)
    print(f"{worker}: draining")


def _command(action: Action) -> Callable[..., None]:
    """The command of an action on a campaign or one of its cases."""

    def act(
        campaign: CampaignName,
        case: CaseName = "",
        conductor: ConductorOptions = ConductorOptions(),
    ) -> None:
        from conductor.commands.client import client_of

        with client_of(conductor) as client:
            changed = client.control(action, campaign=campaign, case=case)
        print(f"{action} {campaign}{f' {case}' if case else ''}: {counted(changed, 'case')}")

    return act
