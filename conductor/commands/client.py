"""A client of a conductor that serves: submit, status, events, stop."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import msgspec

from schemas import SCHEMA_VERSION
from schemas.campaign import Campaign
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Control, Explain, Reply, Request, StatusRequest, Stop, Submit
from schemas.wire.rpc_routes import route_key
from schemas.wire.status import ConductorStatus
from twin.base.errors import InfrastructureError, UsageError
from twin.base.software import software_digest
from twin.fabric.connection_options import ConductorOptions
from twin.fabric.discovery import choose_target
from twin.fabric.endpoint import host_and_port
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import join

CONNECT_TIMEOUT_S = 5.0
TRIES = 3
"""Requests are idempotent: an unanswered one is sent again."""
SUBMIT_S = 30.0
"""Longest wait for a submission to be on disk, before it is sent again [s]."""


def client_of(conductor: ConductorOptions, role: Role = Role.admin) -> ConductorClient:
    """A client of the conductor that the command line names, with a key of ``role``."""
    place = (conductor.connect, conductor.state, conductor.namespace, conductor.key)
    return ConductorClient(*place, role)


class ConductorClient:
    """Talks to the conductor at ``connect``, or to the one that serves ``state``."""

    def __init__(
        self,
        connect: str,
        state: Path | None,
        namespace: str,
        key: Path | None = None,
        role: Role = Role.admin,
    ) -> None:
        """``role``: which key is taken, where ``key`` or ``state`` is a folder of several."""
        target = choose_target(connect, state, namespace, key, role)
        self._where = target.endpoint
        self._bus = join(target, CONNECT_TIMEOUT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bus.close()

    def submit(
        self,
        campaign: Campaign,
        out: str,
        priority: int = 0,
        patience_s: float = SUBMIT_S,
    ) -> str:
        """Submit; returns the campaign folder, as the conductor sees it.

        ``patience_s``: before it is asked again [s].
        """
        request = Submit(
            v=SCHEMA_VERSION,
            campaign=msgspec.to_builtins(campaign),
            software=software_digest(),
            out=out,
            priority=priority,
        )
        self._ask(request, timeout_s=patience_s)
        return str(self.status()["campaigns"][campaign.campaign]["out"])

    def status(self, *, running: bool = False) -> ConductorStatus:
        """The conductor's state; with ``running`` also the cases that run now."""
        return self._ask(StatusRequest(v=SCHEMA_VERSION, running=running)).status

    def on_event(self, handler: Callable[[], None]) -> None:
        """Call ``handler`` whenever the conductor publishes a fact, on a thread of the bus."""
        self._bus.subscribe(topics.EVENT.key, lambda _: handler())

    def explain(self, campaign: str, case: str) -> list[str]:
        """Sentences about why a case waits, runs or ended."""
        answer = self._ask(Explain(v=SCHEMA_VERSION, campaign=campaign, case=case)).status
        return [str(line) for line in answer["explain"]]

    def control(
        self,
        action: Literal["pause", "resume", "cancel", "retry", "drain"],
        *,
        campaign: str = "",
        case: str = "",
        worker: str = "",
    ) -> int:
        """Act on a campaign, a case or a worker; returns how many were changed."""
        request = Control(
            v=SCHEMA_VERSION, action=action, campaign=campaign, case=case, worker=worker
        )
        return int(self._ask(request).status["changed"])

    def stop(self) -> None:
        """Drain; a conductor that ends before its answer has arrived has heard it."""
        try:
            self._ask(Stop(v=SCHEMA_VERSION))
        except InfrastructureError:
            if not self._has_ended():
                raise

    def _has_ended(self) -> bool:
        """Whether nobody listens any more where this client has connected."""
        try:
            socket.create_connection(host_and_port(self._where), CONNECT_TIMEOUT_S).close()
        except ConnectionRefusedError:
            return True
        except OSError:  # the network, of which nothing follows
            return False
        return False

    def _ask(self, request: Request, timeout_s: float = 5.0) -> Reply:
        for _ in range(TRIES):
            data = self._bus.request(route_key(request), encode(request), timeout_s)
            if data is None:
                continue
            reply: Reply = decode(data, Reply)
            if reply.error:
                raise UsageError(reply.error)
            return reply
        raise InfrastructureError(
            f"{self._where}: no conductor answers; check the address and --namespace"
        )
