"""A conductor, its disk, its network and its workers in virtual time, all driven by one seed.

The engine is the real one. Messages are lost, doubled, delayed and overtaken; workers crash and
freeze; the disk refuses; the conductor dies before a commit, after it, and between two replies.
An oracle that knows nothing of the core reads the disk and the replies.
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from conductor_bench import S, campaign
from conductor_swarm_worker import Worker

from conductor.core.facts import (
    AttemptEnded,
    CaseEnded,
    Committed,
    Durable,
    Fact,
    Image,
    LateAttempt,
    Leased,
    Replied,
    Retried,
    Snapshot,
    WorkerLeft,
    is_durable,
)
from conductor.core.fold import fold
from conductor.core.grant import broken
from conductor.core.invariants import check
from conductor.core.state import Config
from conductor.journal.store import JournalError
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Control, Reply, Submit

MS = 1_000_000
"""One millisecond [ns]."""
FAULTS_S = 45
"""Faults stop after this [virtual s]."""
PATIENCE_S = 400
"""Then everything must end within this [virtual s]."""
CASES = 24
WORKERS = 3


class CrashError(BaseException):
    """The conductor process dies here."""


@dataclass(slots=True)
class Rates:
    """Probabilities of faults."""

    loss: float = 0.08
    double: float = 0.08
    delay: float = 0.15
    disk: float = 0.02
    crash_disk: float = 0.01
    crash_reply: float = 0.01
    worker_crash: float = 0.02
    worker_freeze: float = 0.03
    attempt: float = 0.06
    rig_death: float = 0.08
    meddle: float = 0.3


@dataclass(slots=True)
class Disk:
    """Facts as bytes; a commit happens as a whole or not at all."""

    swarm: Swarm
    facts: list[bytes] = field(default_factory=list)
    images: dict[str, bytes] = field(default_factory=dict)
    replies: dict[str, bytes] = field(default_factory=dict)

    def append(self, facts: Sequence[Fact]) -> None:
        durable = [fact for fact in facts if is_durable(fact)]
        if not durable:
            return
        if self.swarm.chance("disk"):
            raise JournalError("storage: no space left; retry")
        if self.swarm.chance("crash_disk"):
            raise CrashError
        for fact in durable:
            if isinstance(fact, Replied):
                self.replies[fact.worker] = encode(fact)
                continue
            if isinstance(fact, Snapshot):
                self.swarm.counts["snapshots"] += 1
                self.images.update({image.key: image.data for image in fact.images})
                self.facts.clear()
                continue
            if isinstance(fact, WorkerLeft):
                self.replies.pop(fact.worker, None)
            self.facts.append(encode(fact))
            try:
                self.swarm.oracle.committed(fact)
            except AssertionError as error:  # the engine would take it for a fault of its own
                self.swarm.broken = str(error)
        if self.swarm.chance("crash_disk"):
            raise CrashError

    def probe(self) -> None:
        if self.swarm.chance("disk"):
            raise JournalError("storage: still no space left; retry")

    def fold(self) -> Iterator[Fact]:
        if self.images:
            yield Snapshot(images=[Image(key, data) for key, data in self.images.items()])
        for data in [*self.facts, *self.replies.values()]:
            yield decode(data, Durable)


@dataclass(slots=True)
class Oracle:
    """What is on disk, and whether replies and later facts keep to it."""

    leased: dict[int, str] = field(default_factory=dict)
    live: dict[str, set[int]] = field(default_factory=dict)
    dead: set[int] = field(default_factory=set)
    ends: dict[str, Fact] = field(default_factory=dict)
    left: set[str] = field(default_factory=set)
    """Workers that left or were silent for too long."""
    answers: dict[tuple[str, int], bytes] = field(default_factory=dict)
    kinds: Counter[str] = field(default_factory=Counter)

    def committed(self, fact: Fact) -> None:
        self.kinds[type(fact).__name__] += 1
        match fact:
            case Leased():
                assert fact.token not in self.leased, f"token {fact.token} granted twice"
                assert fact.case not in self.ends, f"{fact.case} granted after its end"
                self.leased[fact.token] = fact.case
                live = self.live.setdefault(fact.case, set())
                assert len(live) == fact.speculative, f"{fact.case} granted beside {live}"
                live.add(fact.token)
                self.kinds["speculative"] += fact.speculative
            case Committed():
                token, case = fact.result.token, fact.result.case
                assert self.leased.get(token) == case, f"{case} committed with a foreign token"
                assert token not in self.dead, f"{case} committed with a dead token"
                assert case not in self.ends, f"{case} committed twice"
                self._end(case, fact)
            case AttemptEnded():
                assert fact.token not in self.dead, f"token {fact.token} died twice"
                assert not (fact.charged and fact.reason == "suspect"), "a suspect is charged"
                self.dead.add(fact.token)
                self.live[fact.case].discard(fact.token)
                self.kinds["in_halves"] += fact.group > 0
                self.kinds["evidence"] += fact.evidence
            case CaseEnded():
                assert fact.case not in self.ends, f"{fact.case} ended twice"
                self._end(fact.case, fact)
                self.kinds[fact.outcome] += 1
                self.kinds["quarantined_by_losses"] += "losses" in fact.reason
            case Retried():
                assert isinstance(self.ends.pop(fact.case, None), CaseEnded), "a result is undone"
            case WorkerLeft():
                self.left.add(fact.worker)
                self.kinds["forgotten"] += fact.reason == "silent for too long"
            case LateAttempt():
                assert fact.result.token in self.dead, "a live token was fenced"

    def _end(self, case: str, fact: Fact) -> None:
        self.ends[case] = fact
        self.dead |= self.live.pop(case, set())

    def replied(self, worker: str, data: bytes) -> None:
        reply = decode(data, Reply)
        if reply.error or not reply.seq:
            return
        for lease in reply.leases:
            assert lease.token in self.leased, f"token {lease.token} given out but not on disk"
        for token in set(reply.acks) - set(reply.fenced):
            end = self.ends.get(self.leased.get(token, ""))
            assert isinstance(end, Committed), f"token {token} acknowledged but not on disk"
            assert end.result.token == token, f"token {token} acknowledged for another attempt"
        known = self.answers.setdefault((worker, reply.seq), data)
        assert known == data, f"two answers to {worker} seq {reply.seq}"


class Swarm:
    """The world. Build with a seed, call :meth:`run`."""

    def __init__(self, seed: int, rates: Rates | None = None) -> None:
        self.random = random.Random(seed)
        self.rates = rates or Rates()
        self.now_ns = 0
        self.faulty = True
        self.broken = ""
        """What the oracle found."""
        self.counts: Counter[str] = Counter()
        self.oracle = Oracle()
        self.disk = Disk(self)
        self.config = Config(
            folder="/state",
            ttl_ns=4 * S,
            vanished_ns=S,
            snapshot_facts=40,
            forget_ns=8 * S,
            host_deaths=2,
            spread=seed % 3 == 0,
        )
        self.engine: ConductorEngine | None = None
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._inbox: list[tuple[IncomingRequest, Worker, str]] = []
        self._turn_due = False
        self._submitter = Worker(self, "submitter")
        # Some cases kill whatever runs them, to the very end.
        self.kills_rig = {0: {"repeat_3", "repeat_4"}, 1: {"repeat_9"}}.get(seed % 4, set())
        self.kills_worker = {"repeat_7"} if seed % 4 == 2 else set()

    def run(self) -> Swarm:
        """Safety phase, then liveness phase.

        Raises:
            AssertionError: with the reason.
        """
        self._boot()
        self._submit()
        for number in range(WORKERS):
            self.after(self.random.randint(0, S), Worker(self, f"w{number}").boot)
        self.after(S, self._tick)
        self.after(S, self._meddle)
        self.after(FAULTS_S * S, self._calm)
        end_ns = (FAULTS_S + PATIENCE_S) * S
        while self.faulty or self.engine is None or len(self.oracle.ends) < CASES:
            assert self._heap, "nothing more happens, and cases are left"
            self.now_ns, _, action = heapq.heappop(self._heap)
            assert self.now_ns < end_ns, f"{CASES - len(self.oracle.ends)} cases never ended"
            action()
        self._compare()
        assert self.engine.state.campaigns["alpha"].disagreements == 0
        for case in self.kills_rig | self.kills_worker:
            assert isinstance(self.oracle.ends[case], CaseEnded), f"{case} kills all and passed"
        return self

    def chance(self, fault: str) -> bool:
        """Whether ``fault`` happens now."""
        hit = self.faulty and self.random.random() < getattr(self.rates, fault)
        self.counts[fault] += hit
        return hit

    def after(self, delay_ns: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (self.now_ns + delay_ns, next(self._count), action))

    def carry(self, deliver: Callable[[], None]) -> None:
        """One message over the network."""
        if self.chance("loss"):
            return
        for _ in range(1 + self.chance("double")):
            delay_ns = self.random.randint(MS // 10, 2 * MS)
            if self.chance("delay"):
                delay_ns += self.random.randint(0, 8 * S)
            self.after(delay_ns, deliver)

    def ask(self, worker: Worker, payload: bytes, vanished: str = "") -> None:
        """A request on its way to the conductor."""
        name = worker.name

        def arrive() -> None:
            if self.engine is None:
                return  # no router: nobody answers
            self._inbox.append((IncomingRequest(payload, self.now_ns, vanished), worker, name))
            if not self._turn_due:
                self._turn_due = True
                self.after(self.random.randint(0, 20 * MS), self._turn)

        self.carry(arrive)

    def _turn(self) -> None:
        self._turn_due = False
        if self.engine is None or not self._inbox:
            return
        group, self._inbox = self._inbox[:8], self._inbox[8:]
        errors = self.engine.counters.storage_errors
        try:
            turn = self.engine.turn([message for message, _, _ in group])
        except CrashError:
            self._die()
            return
        self.counts["requests"] += len(group)
        assert not self.broken, self.broken
        assert self.engine.counters.faults == 0, "the core contradicted itself"
        check(self.engine.state)
        self.counts["avoided_hosts"] += any(
            broken(self.engine.state, host) for host in self.engine.state.deaths
        )
        if self.engine.counters.storage_errors > errors or self.random.random() < 0.02:
            self._compare()
        for (_, worker, name), reply in zip(group, turn.replies, strict=True):
            if reply is None:
                continue
            self.oracle.replied(name, reply)
            self.carry(lambda w=worker, n=name, r=reply: w.hear(n, r))  # type: ignore[misc]
            if self.chance("crash_reply"):
                self._die()
                return
        if self._inbox:
            self._turn_due = True
            self.after(MS, self._turn)

    def _tick(self) -> None:
        if self.engine is not None and not self._inbox:
            try:
                turn = self.engine.tick(self.now_ns)
            except CrashError:
                self._die()
            else:
                assert not self.broken, self.broken
                if turn.facts:
                    check(self.engine.state)
        self.after(250 * MS, self._tick)

    def _compare(self) -> None:
        assert self.engine is not None
        assert fold(self.disk.fold(), self.config) == self.engine.state, "memory is not the disk"

    def _die(self) -> None:
        self.counts["conductor_deaths"] += 1
        self.engine = None
        self._inbox.clear()
        self.after(self.random.randint(MS, 6 * S), self._boot)

    def _boot(self) -> None:
        if self.engine is not None:
            return
        try:
            self.engine = ConductorEngine(self.disk, self.config, self.now_ns)
        except (CrashError, JournalError):
            self.after(S, self._boot)
            return
        self._compare()

    def _submit(self) -> None:
        if self.engine is None or not self.engine.state.campaigns:
            self.ask(
                self._submitter, encode(Submit(v=V, campaign=campaign(cases=CASES, attempts_max=2)))
            )
            self.after(S, self._submit)

    def _meddle(self) -> None:
        """People pause, cancel, retry and drain; in the end they let everything go on."""
        campaign = self.engine.state.campaigns.get("alpha") if self.engine else None
        if campaign is not None and self.chance("meddle"):
            action = self.random.choice(["pause", "resume", "cancel", "retry", "drain"])
            case = f"repeat_{self.random.randrange(CASES)}"
            whole = self.random.random() < 0.2 and action not in ("cancel", "retry")
            self._control(action, "" if whole else case)
        if not self.faulty and campaign is not None:
            if campaign.paused:
                self._control("resume", "")
            for state in campaign.ordered:
                if state.paused and state.end is None:
                    self._control("resume", state.case.id)
        self.after(S, self._meddle)

    def _control(self, action: str, case: str) -> None:
        worker = ""
        if action == "drain":
            assert self.engine is not None
            worker = self.random.choice([*self.engine.state.workers, "nobody"])
            case = ""
        request = Control(v=V, action=action, campaign="alpha", case=case, worker=worker)  # type: ignore[arg-type]
        self.ask(self._submitter, encode(request))

    def _calm(self) -> None:
        self.faulty = False
