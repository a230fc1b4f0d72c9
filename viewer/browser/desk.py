"""The control panel's way to running cases: requests of a page -> actions on a simulator."""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Callable
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from schemas import SCHEMA_VERSION
from schemas.files.json_text import decode_json
from schemas.settings import Value, actions_of
from schemas.wire import topics
from schemas.wire.case_files import CaseFilePiece, CaseFileRequest
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Control, Explain, Reply
from schemas.wire.interventions import Action
from schemas.wire.rpc_routes import route_key
from twin.base.errors import TwinError, UnreachableError, UsageError
from twin.fabric.bus import Bus
from twin.fabric.discovery import Target
from twin.fabric.interventions import Attempt, carry_out, running
from twin.fabric.keys.rights import Act, may
from twin.fabric.zenoh_bus import join

ASK_S = 5.0
"""Longest time the conductor may take to answer [s]."""
CONNECT_S = 2.0
"""Longest time the conductor may take to open a session [s]."""


class PanelRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks: settings, or one action, on one attempt."""

    campaign: str
    case: str
    token: Annotated[int, Meta(ge=1)]
    """Token of the attempt, as the list of running ones says."""
    settings: dict[str, str | float | bool] = {}
    """Settings as for ``viewer set``."""
    action: Action | None = None


class Desk:
    """One session for all pages, opened when first needed and again after it broke."""

    def __init__(self, resolve: Callable[[], Target]) -> None:
        """Make a desk without a session; ``resolve``: where the conductor is now."""
        self.token = secrets.token_urlsafe(16)
        """What a page must know: it stands in the address that we print, and nowhere else."""
        self._resolve = resolve
        self._bus: Bus | None = None
        self._endpoint = ""
        """Where that session leads."""
        self._lock = threading.Lock()

    def knows(self, token: str) -> bool:
        """Whether a page may intervene."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def cases(self) -> bytes:
        """The attempts that run, as JSON.

        Raises:
            TwinError: no conductor there, or another version.
        """
        states = running(self.session())
        if not states:
            self._drop()  # nobody there, or the conductor has moved: look for it next time
        return msgspec.json.encode(states)

    def do(self, body: bytes) -> bytes:
        """Carry out what a page asks; the answer says at which tick, and how the case stands.

        Raises:
            TwinError: it cannot be done; one line, which names what was done before it.
        """
        try:
            asked: PanelRequest = decode_json(body, PanelRequest)
            settings: dict[str, Value] = dict(asked.settings)
            actions = actions_of(settings) if settings else []
        except ValueError as error:
            raise UsageError(str(error)) from None
        if asked.action is not None:
            actions.append(asked.action)
        attempt = Attempt(self.session(), asked.campaign, asked.case, asked.token)
        tick, state = -1, None
        for _, reply in carry_out(attempt, actions):
            tick, state = reply.tick, reply.state
        return msgspec.json.encode({"tick": tick, "state": state})

    def operates(self) -> bool:
        """Whether its key may change what a conductor does; without keys everybody may.

        Raises:
            TwinError: there is no conductor, or no key that fits.
        """
        key = self._resolve().key
        return key is None or may(key.role, Act.ask, topics.RPC_ADMIN.key)

    def control(self, request: Control) -> int:
        """Have the conductor do something; the number of cases or workers that it changed.

        Raises:
            UsageError: it refuses, or the key is of a role that may not ask; one line.
            UnreachableError: it does not answer.
        """
        reply = self._ask(request)
        return int(reply.status.get("changed", 0))

    def explain(self, campaign: str, case: str) -> list[str]:
        """Why a case waits, runs or has ended.

        Raises:
            TwinError: as :meth:`control`.
        """
        request = Explain(v=SCHEMA_VERSION, campaign=campaign, case=case)
        return list(self._ask(request).status.get("explain", []))

    def case_file(self, request: CaseFileRequest) -> CaseFilePiece | None:
        """A piece of a file of a committed attempt; None: no answer, or one of another version.

        Raises:
            TwinError: there is no conductor, or its key is of a role that may not ask.
        """
        data = self.session().request(topics.CASE_FILES.key, encode(request), ASK_S)
        if data is None:
            self._drop()  # it may have moved
            return None
        try:
            piece: CaseFilePiece = decode(data, CaseFilePiece)
        except WireError:
            return None
        return piece

    def close(self) -> None:
        """End the session."""
        self._drop()

    def _ask(self, request: Control | Explain) -> Reply:
        data = self.session().request(route_key(request), encode(request), ASK_S)
        if data is None:
            self._drop()  # it may have moved
            raise UnreachableError("the conductor does not answer; ask again in a moment")
        try:
            reply: Reply = decode(data, Reply)
        except WireError as error:
            raise UsageError(f"the conductor: {error}") from None
        if reply.error:
            raise UsageError(reply.error)
        return reply

    def session(self) -> Bus:
        """The session to the conductor: one for all pages, another one where it has moved."""
        target = self._resolve()
        with self._lock:
            if self._bus is not None and target.endpoint != self._endpoint:
                moved, self._bus = self._bus, None  # or the tunnel to it was dug again
                moved.close()
            if self._bus is None:
                self._bus, self._endpoint = join(target, CONNECT_S), target.endpoint
            return self._bus

    def _drop(self) -> None:
        with self._lock:
            bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()


def refusal(error: TwinError) -> bytes:
    """Refusal as JSON, for the page."""
    return msgspec.json.encode({"error": str(error)})
