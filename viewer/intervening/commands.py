"""Commands that intervene in a running case, for :mod:`viewer.cli`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import typer

from schemas.wire.bounds import STEPS_MAX
from twin.base.cli import Output, OutputOption
from twin.base.errors import UsageError
from twin.base.option_record import with_options
from viewer.live.place import LivePlace

if TYPE_CHECKING:
    from schemas.wire.interventions import Action
    from viewer.intervening.command import InterventionOptions

Case = Annotated[str, typer.Argument(help="Case id, as the wall shows it.")]
Words = Annotated[
    list[str],
    typer.Argument(
        help="KEY=VALUE: weather, hour, cloud, fog, rain, snow, wind, x_m, y_m, yaw_deg, "
        "speed_mps, lights (low+fog, off, stack), gnss_noise, imu_bias ..., pace (1, 0.5, max); "
        "object.NAME.x_m, .y_m, .yaw_deg, .speed_mps, object.NAME=away, object.NAME=free."
    ),
]
Campaign = Annotated[str, typer.Option(help="If several campaigns have a case of that name.")]


def register(app: typer.Typer) -> None:
    """Add the commands to the viewer's."""
    app.command("set")(with_options(set_))
    for name, text in _PLAIN.items():
        app.command(name, help=text)(with_options(_plain(name)))
    app.command()(with_options(step))
    app.command()(with_options(takeover))


def set_(
    case: Case,
    settings: Words,
    place: LivePlace = LivePlace(),
    campaign: Campaign = "",
    output: OutputOption = Output.human,
) -> None:
    """Change weather, hour, place, lamps, sensor errors, pace or objects of a running case.

    `viewer look` names the objects. All but the pace cost the attempt its verdict; the case
    then runs once more, unchanged.
    """
    from schemas.object_settings import split_objects
    from schemas.settings import actions_of, parse_words

    try:
        words, objects = split_objects(parse_words(settings))
        actions = actions_of(words) if words or not objects else []
    except ValueError as error:
        raise UsageError(str(error)) from None
    _intervene(actions, _options(case, place, campaign, output), objects)


def step(
    case: Case,
    ticks: Annotated[int, typer.Argument(min=1, max=STEPS_MAX, help="Control ticks.")] = 1,
    place: LivePlace = LivePlace(),
    campaign: Campaign = "",
    output: OutputOption = Output.human,
) -> None:
    """Let a case go on for some ticks and then stand still; its values stay the same."""
    from schemas.wire.interventions import Step

    _intervene([Step(ticks)], _options(case, place, campaign, output))


def takeover(
    case: Case,
    place: LivePlace = LivePlace(),
    campaign: Campaign = "",
) -> None:
    """Drive a running case by the keyboard of this terminal, in real time, until Q.

    The attempt then gives the case no verdict; the case runs once more, unchanged.
    """
    from viewer.intervening.command import take_over

    options = _options(case, place, campaign, Output.human)
    raise typer.Exit(take_over(options))


_PLAIN = {
    "pause": "Let a running case stand still; others go on, and its values stay the same.",
    "resume": "Let a case that stands still go on.",
    "release": "Give a car that was taken over back to its stack.",
    "look": "Say how a running case stands, with its movable objects.",
}


def _plain(name: str):  # type: ignore[no-untyped-def]
    def command(
        case: Case,
        place: LivePlace = LivePlace(),
        campaign: Campaign = "",
        output: OutputOption = Output.human,
    ) -> None:
        from schemas.wire.interventions import GiveBack, Pause, Query, Resume

        actions = {"pause": Pause, "resume": Resume, "release": GiveBack, "look": Query}
        _intervene([actions[name]()], _options(case, place, campaign, output))

    return command


def _intervene(
    actions: list[Action],
    options: InterventionOptions,
    objects: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
) -> None:
    from viewer.intervening.command import intervene

    raise typer.Exit(intervene(options, actions, objects))


def _options(case: str, place: LivePlace, campaign: str, output: Output) -> InterventionOptions:
    from twin.fabric.keys.roles import Role
    from viewer.intervening.command import InterventionOptions

    where = place.live(role=Role.admin)
    return InterventionOptions(case, where, campaign, json=output is Output.json)
