"""One request in the making: the state, the time, and the facts so far."""

from __future__ import annotations

from typing import Any

from conductor.core.facts import Fact
from conductor.core.fold import apply
from conductor.core.state import State, WorkerState
from schemas import SCHEMA_VERSION
from schemas.wire.control import Reply
from schemas.wire.status import ConductorStatus


class RequestTurn:
    """Collects the facts of one request, applying each as it is made."""

    __slots__ = ("facts", "now_ns", "state")

    def __init__(self, state: State, now_ns: int) -> None:
        self.state = state
        self.now_ns = now_ns
        self.facts: list[Fact] = []

    def emit(self, fact: Fact) -> None:
        """Add a fact."""
        apply(self.state, fact)
        self.facts.append(fact)

    def reply(
        self,
        worker: WorkerState | None = None,
        *,
        status: ConductorStatus | None = None,
        **fields: Any,
    ) -> Reply:
        """A reply with the fields that every reply has; ``worker``: to whom, if to one."""
        return Reply(
            v=SCHEMA_VERSION,
            epoch=self.state.epoch,
            ttl_s=self.state.config.ttl_ns / 1e9,
            left=self.state.left,
            drain=self.state.draining or (worker is not None and worker.draining),
            status=status or {},
            **fields,
        )
