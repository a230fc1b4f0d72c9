"""One turn of the conductor: decode, decide, commit, and only then let the replies out.

No threads and no clock: the fault swarm drives this very code.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Protocol

import msgspec

from conductor.core.decisions import close, decide, start, take_found, tick, worker_lost
from conductor.core.facts import Fact
from conductor.core.fold import fold, revive
from conductor.core.lease import next_expiry_ns
from conductor.core.state import Config, State
from conductor.journal.store import JournalError
from schemas import SCHEMA_VERSION
from schemas.escape import escape
from schemas.wire.codec import WireError, encode
from schemas.wire.control import Reply, Request, Sealed, StatusRequest, Submit
from schemas.wire.rpc_routes import read_request
from schemas.wire.status import ConductorStatus
from twin.base.errors import TwinError

RETRY_S = 1.0
"""A worker asks again after this while the storage refuses [s]."""

_log = logging.getLogger(__name__)


class FactStore(Protocol):
    """Where facts become durable; see :class:`conductor.journal.store.Journal`."""

    def append(self, facts: Sequence[Fact]) -> None:
        """Append all facts, or nothing."""

    def probe(self) -> None:
        """Raise while nothing can be written."""

    def fold(self) -> Iterable[Fact]:
        """Facts that were appended, all of them."""


class Auditor(Protocol):
    """Writer of the log of refusals and commands; see :class:`conductor.serve.audit.Audit`."""

    def refused(self, route: str, words: str) -> None:
        """A message that came on the RPC route ``route`` was none."""

    def asked(self, route: str, request: Request, error: str) -> None:
        """Request that came on the RPC route; it was refused if there is an ``error``."""


@dataclass(frozen=True, slots=True)
class IncomingRequest:
    """A request as it came in, or a liveliness hint about a worker (``payload`` empty)."""

    payload: bytes
    arrived_ns: int
    """Time at which it arrived, not when its turn came: a stalled disk must not expire leases whose
    heartbeats wait in line."""
    vanished: str = ""
    route: str = ""
    """Key on which it came; empty: from inside this process."""


@dataclass(slots=True)
class EngineCounters:
    """Counts of what the engine has done since it started."""

    requests: int = 0
    refused: int = 0
    """Requests that were no valid message."""
    fenced: int = 0
    """Results that came without a live token."""
    faults: int = 0
    """Mistakes of our own, answered with an error."""
    storage_errors: int = 0
    facts: int = 0
    commits: int = 0


@dataclass(slots=True)
class TurnResult:
    """What one turn brought: a reply per message (None: none is due), and the committed facts."""

    replies: list[bytes | None] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)


class ConductorEngine:
    """The state of one conductor, the journal under it, and the order between them."""

    def __init__(
        self,
        journal: FactStore,
        config: Config,
        now_ns: int,
        check_folder: Callable[[Submit], str] = lambda _: "",
        counters_beyond: Callable[[], dict[str, float]] = dict,
        audit: Auditor | None = None,
        lay_before: Callable[[State], str] = lambda _: "",
        claim: Callable[[State], int] = lambda _: 0,
    ) -> None:
        """Fold the journal and raise the epoch, on disk.

        Args:
            journal: where facts become durable.
            config: limits and options.
            now_ns: the time [ns].
            check_folder: what is wrong with a submission's folder, in one line, or nothing.
            counters_beyond: what the shell has counted, for the status.
            audit: hears of refusals and requests.
            lay_before: where the state folder of a journal lay that does not say so.
            claim: claims a store for the journal; the least epoch that it may raise to.

        Raises:
            JournalError: the journal cannot be read or written.
        """
        self.counters = EngineCounters()
        self.storage_error = ""
        """Why the storage refuses, so that nothing is granted or committed; empty: it does not."""
        self._journal = journal
        self._check_folder = check_folder
        self._counters_beyond = counters_beyond
        self._audit = audit
        self._config = config
        self._now_ns = now_ns
        self.state = self._folded()
        before = "" if self.state.folder else lay_before(self.state)
        journal.append(start(self.state, before, claim(self.state)))
        revive(self.state, now_ns)

    def turn(self, messages: Sequence[IncomingRequest]) -> TurnResult:
        """Handle ``messages`` in order, in one transaction."""
        if self.storage_error and not self._storage_works(messages[-1].arrived_ns):
            return TurnResult([self._storage_reply(m) for m in messages])
        try:
            return self._commit([self._decided(message) for message in messages])
        except JournalError as error:
            self._storage_failed(error)
            return TurnResult([self._storage_reply(m) for m in messages])
        except Exception:
            # The state may hold half a decision, and facts of the others are not yet on disk.
            self._refold()
            if len(messages) > 1:
                return self._one_by_one(messages)
            return TurnResult([self._our_mistake()])

    def tick(self, now_ns: int) -> TurnResult:
        """Expire leases; call only when no message waits."""
        if self.storage_error and not self._storage_works(now_ns):
            return TurnResult()
        try:
            return self._commit([(tick(self.state, self._clock(now_ns)), None)])
        except JournalError as error:
            self._storage_failed(error)
            return TurnResult()

    def take_found(self, found: Sequence[Sealed], now_ns: int) -> TurnResult:
        """Commit results that were found in a store.

        Raises:
            JournalError: the storage refuses.
        """
        return self._commit([(take_found(self.state, found, self._clock(now_ns)), None)])

    def close(self) -> None:
        """A clean end: the next start reads a snapshot; without one it only takes longer."""
        if self.storage_error:
            return
        try:
            self._journal.append(close(self.state))
        except JournalError as error:
            _log.error("%s", error)

    def woke(self, now_ns: int) -> None:
        """Go on after this process was frozen, or waited long for the disk: words of workers may
        still be on their way, so every live lease gets a full time to live, as after a restart."""
        revive(self.state, self._clock(now_ns))

    def health(self) -> ConductorStatus:
        """What a status says beyond the state: the counters, and whether the storage works."""
        return {
            "storage_error": self.storage_error,
            "counters": asdict(self.counters) | self._counters_beyond(),
        }

    def next_expiry_ns(self) -> int:
        """When :meth:`tick` has something to do [ns]."""
        return next_expiry_ns(self.state)

    def _clock(self, now_ns: int) -> int:
        """Time never runs backwards, though messages are stamped on several threads."""
        self._now_ns = max(self._now_ns, now_ns)
        return self._now_ns

    def _decided(self, message: IncomingRequest) -> tuple[list[Fact], bytes | None]:
        now_ns = self._clock(message.arrived_ns)
        if message.vanished:
            return worker_lost(self.state, message.vanished, now_ns), None
        self.counters.requests += 1
        try:
            # The access list knows keys, not requests: what is none of the sender's business must
            # not come in by a route that is open to it.
            request = read_request(message.payload, message.route)
        except WireError as error:
            self.counters.refused += 1
            if self._audit is not None:
                self._audit.refused(message.route, str(error))
            return [], self._error(str(error))
        before = self.state.applied
        try:
            if isinstance(request, Submit) and (error_line := self._check_folder(request)):
                self._asked(message, request, error_line)
                return [], self._error(error_line)
            facts, reply = decide(self.state, request, now_ns)
        except Exception:
            if self.state.applied != before:
                raise  # half a decision
            return [], self._our_mistake()
        self._asked(message, request, reply.error)
        self.counters.fenced += len(reply.fenced)
        if isinstance(request, StatusRequest):
            reply = msgspec.structs.replace(reply, status={**reply.status, **self.health()})
        return facts, encode(reply)

    def _asked(self, message: IncomingRequest, request: Request, error: str) -> None:
        if self._audit is not None:
            self._audit.asked(message.route, request, error)

    def _commit(self, decided: Sequence[tuple[list[Fact], bytes | None]]) -> TurnResult:
        facts = [fact for made, _ in decided for fact in made]
        self._journal.append(facts)
        self.counters.facts += len(facts)
        self.counters.commits += 1
        return TurnResult([reply for _, reply in decided], facts)

    def _one_by_one(self, messages: Sequence[IncomingRequest]) -> TurnResult:
        whole = TurnResult()
        for message in messages:
            part = self.turn([message])
            whole.replies += part.replies
            whole.facts += part.facts
        return whole

    def _folded(self) -> State:
        """What the journal says.

        Raises:
            JournalError: it cannot be read, or contradicts itself.
        """
        try:
            return fold(self._journal.fold(), self._config)
        except TwinError:
            raise
        except Exception as error:  # SQLite keeps no checksums: a fact may be any other
            words = escape(f"{type(error).__name__}: {error}", 200)
            raise JournalError(
                f"the journal is damaged: its facts contradict each other ({words}); put back a "
                "copy of conductor.db, or choose another folder"
            ) from None

    def _refold(self) -> None:
        """Back to what is on disk; leases live on, since nobody was told otherwise."""
        draining = self.state.draining
        self.state = self._folded()
        self.state.draining = draining
        revive(self.state, self._now_ns)

    def _storage_failed(self, error: JournalError) -> None:
        self.counters.storage_errors += 1
        self.storage_error = str(error)
        _log.error("%s", error)
        self._refold()

    def _storage_works(self, now_ns: int) -> bool:
        self._clock(now_ns)
        try:
            self._journal.probe()
        except JournalError as error:
            self.storage_error = str(error)
            return False
        _log.warning("the storage works again")
        self.storage_error = ""
        revive(self.state, self._now_ns)
        return True

    def _storage_reply(self, message: IncomingRequest) -> bytes | None:
        if message.vanished:
            return None
        return self._error(self.storage_error, RETRY_S)

    def _our_mistake(self) -> bytes:
        """The answer to a request that raised; call it where that is being handled."""
        self.counters.faults += 1
        _log.exception("a request could not be decided")
        return self._error("internal error of the conductor; see its log")

    def _error(self, error: str, retry_after_s: float = 0.0) -> bytes:
        return encode(
            Reply(
                v=SCHEMA_VERSION,
                epoch=self.state.epoch,
                error=error,
                retry_after_s=retry_after_s,
            )
        )
