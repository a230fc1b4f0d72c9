"""Interventions in a running case from the command line: `viewer set`, `pause`, `takeover` ..."""

from __future__ import annotations

import json
import os
import select
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import msgspec

from schemas.object_settings import object_actions
from schemas.wire.interventions import (
    Action,
    GiveBack,
    InterventionState,
    ObjectState,
    Pause,
    Query,
    Resume,
    Step,
    changes_simulation,
)
from schemas.wire.view import clock
from twin.base.errors import UsageError
from twin.fabric.interventions import RunningAttempt, carry_out, find
from twin.fabric.zenoh_bus import join
from viewer.intervening.pedals import HELP, Pedals, keys
from viewer.live.command import LiveOptions

PERIOD_S = 0.1
"""Time between two messages of the pedals, also when nothing has changed: silence gives the car
back [s]."""
CONNECT_S = 5.0
"""Longest time the conductor may take to answer [s]."""


@dataclass(frozen=True, slots=True)
class InterventionOptions:
    """The case to intervene in, and where it runs."""

    case: str
    where: LiveOptions
    campaign: str = ""
    """Needed if several campaigns have a case of that name."""
    json: bool = False


def intervene(
    options: InterventionOptions, actions: list[Action], objects: Mapping[str, Mapping[str, str]]
) -> int:
    """Carry out actions, settings together; the exit code.

    Args:
        options: the case.
        actions: what is known without looking at it.
        objects: settings of its objects, see :mod:`schemas.object_settings`.

    Raises:
        UsageError: no such case runs, or something cannot be done; what was done before it stays.
        InfrastructureError: nobody answers.
    """
    with attempt(options) as running:
        try:
            actions = [*actions, *object_actions(objects, running.state.objects)]
        except ValueError as error:
            raise UsageError(str(error)) from None
        for action, reply in carry_out(running, actions):
            if options.json or isinstance(action, Query):
                continue
            print(f"{options.case}: {_told(action)} at tick {reply.tick}{_effect(action)}")
        state = running.state
        if options.json:
            print(json.dumps(msgspec.to_builtins(state)))
        elif any(isinstance(action, Query) for action in actions):
            print("\n".join(described(state)))
    return 0


@contextmanager
def attempt(options: InterventionOptions) -> Iterator[RunningAttempt]:
    """The running attempt, while a session to its simulator is open."""
    with ExitStack() as stack:
        tunnel = options.where.tunnel()
        if tunnel is not None:
            stack.callback(tunnel.close)
        target = options.where.target() if tunnel is None else tunnel.target()
        bus = join(target, CONNECT_S)
        stack.callback(bus.close)
        yield find(bus, options.case, options.campaign)


def take_over(options: InterventionOptions) -> int:
    """Drive by the keyboard of this terminal until Q; the exit code.

    Raises:
        UsageError: no terminal here, or no such case runs.
    """
    if not sys.stdin.isatty() or os.name != "posix":
        raise UsageError(
            "takeover reads the keyboard of a terminal; scripts steer by devkit.client.Client, "
            "and `viewer web` has a keyboard too"
        )
    with attempt(options) as running, _raw_terminal():
        say(HELP)
        try:
            _drive(running)
        finally:
            sys.stderr.write("\n")
            try:
                running.do(GiveBack())
                say("given back")
            except UsageError as ended:
                say(str(ended))
    return 0


def _drive(running: RunningAttempt) -> None:
    """Drive by the keyboard until the case ends or the driver wants no more."""
    pedals, told_s = Pedals(), 0.0
    while True:
        ready, _, _ = select.select([sys.stdin], [], [], PERIOD_S)
        for key in keys(os.read(sys.stdin.fileno(), 64)) if ready else []:
            if key in ("q", "esc", "\x03", "\x04"):
                return
            try:
                if key == "p":
                    running.do(Resume() if running.state.paused else Pause())
                elif key == "n":
                    running.do(Step())
            except UsageError:
                return
            pedals = pedals.press(key)
        if ready and time.monotonic() - told_s < PERIOD_S / 2:
            continue  # a key that repeats
        told_s = time.monotonic()
        try:
            running.do(pedals.action())
        except UsageError:
            return
        sys.stderr.write("\r" + line_of(running.state, pedals).ljust(79))
        sys.stderr.flush()


@contextmanager
def _raw_terminal() -> Iterator[None]:
    """Keys as they are pressed."""
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def line_of(state: InterventionState, pedals: Pedals) -> str:
    """What the driver reads."""
    paused = "  PAUSED" if state.paused else ""
    return (
        f"{state.sim_time_ns / 1e9:6.2f} s  {state.speed_mps:5.1f} m/s  throttle "
        f"{pedals.throttle:.1f}  brake {pedals.brake:.2f}  steering {pedals.steering_rad:+.2f}"
        f"{paused}"
    )


def described(state: InterventionState) -> list[str]:
    """State of a case, in lines for people."""
    there = [shown for shown in state.objects if shown.present or shown.by_hand]
    lines = [
        f"{state.case} of {state.campaign}, attempt {state.attempt}: tick {state.tick}, "
        f"{state.sim_time_ns / 1e9:g} s"
        + (", paused" if state.paused else "")
        + (", driven by hand" if state.taken_over else "")
        + (f", pace {state.pace:g}" if state.pace is not None else ""),
        f"weather {state.weather or 'by intensities'}, {clock(int(state.time_of_day_min))}",
        f"ego x {state.x_m:.2f} m, y {state.y_m:.2f} m, {state.speed_mps:.2f} m/s",
        f"{state.changes} changes by hand" + (": no verdict" if state.changes else ""),
    ]
    return lines + [
        f"object {shown.object}: {_named(shown)} at x {shown.x_m:.1f} m, y {shown.y_m:.1f} m"
        + ("" if shown.present else ", away")
        + (", by hand" if shown.by_hand else "")
        for shown in there
    ]


def _named(shown: ObjectState) -> str:
    return f"{shown.kind} '{shown.name}'" if shown.name else shown.kind


def _told(action: Action) -> str:
    return str(type(action).__struct_config__.tag)


def _effect(action: Action) -> str:
    return "; this attempt gives the case no verdict" if changes_simulation(action) else ""


def say(line: str) -> None:
    """One line for people, on standard error."""
    print(f"viewer: {line}", file=sys.stderr, flush=True)
