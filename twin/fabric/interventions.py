"""Interventions in running cases from outside: finds an attempt and asks its simulator.

From a thin client the way leads through the conductor's router to the view session of the rig
(``view/<campaign>/<case>/control``); beside a rig straight to its simulator
(``drive/<rig>/control``). Both end in the same place. Requests name the attempt's token, so that
what was meant for one attempt never hits the next.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Sequence
from typing import Protocol

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Explain, Reply, StatusRequest
from schemas.wire.interventions import (
    Action,
    ControlReply,
    ControlRequest,
    InterventionState,
    Query,
    Setting,
    Together,
    parts_of,
)
from twin.base.errors import InfrastructureError, UnreachableError, UsageError
from twin.fabric.bus import Bus

ANSWER_S = 5.0
"""How long a simulator may take to answer: until its next tick [s]."""
TRIES = 3
"""A request without an answer is sent again; it is done once [-]."""
CONDUCTOR_S = 3.0
"""How long the conductor may take to say why nobody answers [s]."""


class Attempt:
    """One attempt of a case, by its token; it may have ended."""

    def __init__(self, bus: Bus, campaign: str, case: str, token: int, key: str = "") -> None:
        """``key``: where to ask; empty: where viewers do."""
        self.case = case
        _check_names(campaign, case)
        self._bus = bus
        self._token = token
        self._key = key or topics.VIEW_CONTROL.key.format(campaign=campaign, case=case)

    def do(self, action: Action) -> ControlReply:
        """Carry out one action; the answer says at which control tick it was applied.

        Raises:
            UsageError: it cannot be done, or that attempt has ended; one line.
            UnreachableError: its simulator does not answer any more.
        """
        request = ControlRequest(
            v=SCHEMA_VERSION,
            id=secrets.token_hex(8),
            action=action,
            case=self.case,
            token=self._token,
        )
        for _ in range(TRIES):
            # Of a case that runs twice, the other attempt refuses the token.
            replies = _ask(self._bus, self._key, request)
            done = next((reply for reply in replies if not reply.error), None)
            if done is not None:
                return done
            if replies:
                raise UsageError(replies[0].error)
        raise UnreachableError(
            f"case {self.case}: its simulator does not answer any more; "
            "it may have ended: see conductor explain"
        )


class ActionTarget(Protocol):
    """Anything that carries out one action."""

    def do(self, action: Action) -> ControlReply:
        """See :meth:`Attempt.do`."""


def carry_out(
    target: ActionTarget, actions: Sequence[Action]
) -> Iterator[tuple[Action, ControlReply]]:
    """Actions with their answers: settings together, at the same tick, all of them or none; then
    the others one after the other.

    Raises:
        UsageError: one is refused; the line says which were done before.
        UnreachableError: the simulator does not answer any more; the same.
    """
    settings = [action for action in actions if isinstance(action, Setting)]
    others: list[Action] = [action for action in actions if not isinstance(action, Setting)]
    asked = [Together(settings), *others] if len(settings) > 1 else list(actions)
    done: list[str] = []
    for action in asked:
        try:
            reply = target.do(action)
        except (UsageError, UnreachableError) as error:
            if not done:
                raise
            raise type(error)(f"{error}; done before it: {', '.join(done)}") from None
        for part in parts_of(action):
            done.append(f"{part.__struct_config__.tag} at tick {reply.tick}")
            yield part, reply


class RunningAttempt:
    """An attempt that was found running, and how it stood at the last answer."""

    def __init__(self, bus: Bus, state: InterventionState, key: str = "") -> None:
        self.state = state
        self._attempt = Attempt(bus, state.campaign, state.case, state.token, key)

    def do(self, action: Action) -> ControlReply:
        """See :meth:`Attempt.do`."""
        reply = self._attempt.do(action)
        if reply.state is not None:
            self.state = reply.state
        return reply


def running(bus: Bus, campaign: str = "*", case: str = "*") -> list[InterventionState]:
    """Attempts that take interventions from here, by campaign and case.

    Raises:
        UsageError: a simulator speaks another version; one line.
    """
    key = topics.VIEW_CONTROL.key.format(campaign=campaign, case=case)
    replies = _ask(bus, key, ControlRequest(v=SCHEMA_VERSION, id="", action=Query()))
    states = [reply.state for reply in replies if reply.state is not None]
    return sorted(states, key=lambda state: (state.campaign, state.case, state.token))


def find(bus: Bus, case: str, campaign: str = "") -> RunningAttempt:
    """The running attempt of a case, through the conductor's router.

    Raises:
        UsageError: no such case runs, or its rig takes no interventions; one line that says why.
        InfrastructureError: nobody answers at all.
    """
    _check_names(campaign, case)
    states = running(bus, campaign or "*", case)
    campaigns = sorted({state.campaign for state in states})
    if len(campaigns) > 1:
        raise UsageError(f"case '{case}' runs in {', '.join(campaigns)}; give --campaign")
    if not states:
        raise _why_not(bus, case, campaign)
    state = states[-1]  # of two attempts at once the later one
    return RunningAttempt(bus, state)


def find_in_rig(bus: Bus, rig: str, case: str = "", slot: int = -1) -> RunningAttempt:
    """The attempt that runs in a rig, over the rig's own session.

    Raises:
        UsageError: no such case runs there; one line.
        UnreachableError: nobody answers.
    """
    key = topics.CONTROL.key.format(rig=rig)
    request = ControlRequest(v=SCHEMA_VERSION, id="", action=Query(), case=case, slot=slot)
    for reply in _ask(bus, key, request):
        if reply.state is None:
            raise UsageError(f"rig {rig}: {reply.error}")
        return RunningAttempt(bus, reply.state, key)
    raise UnreachableError(f"rig {rig}: its simulator does not answer; check endpoint and rig")


def _check_names(campaign: str, case: str) -> None:
    """Names become parts of a key; a pattern among them would mean other people's cases, too."""
    for what, name in (("a campaign", campaign), ("a case", case)):
        if wrong := sorted(set(name) & set("*$?#/")):
            raise UsageError(f"{what}'s name: given '{name}', not allowed: {' '.join(wrong)}")


def _ask(bus: Bus, key: str, request: ControlRequest) -> list[ControlReply]:
    try:
        return [decode(data, ControlReply) for data in bus.gather(key, encode(request), ANSWER_S)]
    except WireError as error:
        raise UsageError(f"the simulator: {error}") from None


def _why_not(bus: Bus, case: str, campaign: str) -> UsageError | InfrastructureError:
    """Why nobody answers for a case, as the conductor knows it."""
    data = bus.request(topics.RPC_STATUS.key, encode(StatusRequest(v=SCHEMA_VERSION)), CONDUCTOR_S)
    if data is None:
        return UnreachableError("no conductor answers there; check --connect and --namespace")
    try:
        status: Reply = decode(data, Reply)
        known = list(status.status.get("campaigns", {}))
        names = [campaign] if campaign else known
        for name in names:
            request = Explain(v=SCHEMA_VERSION, campaign=name, case=case)
            answer = bus.request(topics.RPC_STATUS.key, encode(request), CONDUCTOR_S)
            reply: Reply | None = None if answer is None else decode(answer, Reply)
            if reply is None or reply.error:
                continue
            line = str(reply.status["explain"][0])
            if line.startswith("leased"):
                return UsageError(
                    f"case '{case}' runs, but cannot be steered: its rig is just starting, or "
                    "shows nothing (--view none or record); run it with --view live"
                )
            return UsageError(f"case '{case}' does not run: {line}")
    except WireError as error:
        return UsageError(f"the conductor: {error}")
    return UsageError(f"no case '{case}' in {', '.join(names) or 'any campaign here'}")
