"""The worker's decisions, pure: events in, effects out. No clock, process, socket or file.

The shell (:mod:`twin.worker.shell`) feeds events with the time and carries out the effects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from schemas import SCHEMA_VERSION
from schemas.case import CASE_VERSION, Case
from schemas.identity import rig_key
from schemas.wire.bounds import SEALED_MAX
from schemas.wire.control import (
    Beat,
    Bye,
    Ended,
    Hello,
    Lease,
    Next,
    Release,
    Reply,
    Request,
    Result,
    Sealed,
    Touch,
    noop_result,
)
from schemas.wire.interventions import JOURNAL_FILE
from schemas.words import agree, counted
from twin.worker.effects import (
    AbandonToken,
    Ask,
    AssignLease,
    Effect,
    FailCase,
    FailUnbegun,
    KeepLogs,
    Leave,
    Say,
    SpoolForget,
    SpoolWrite,
    StartRig,
    StopRig,
)
from twin.worker.held import Held, Rig, Silence, over_memory
from twin.worker.spool import pack, unpack

SECOND_NS = 1_000_000_000
RETRY_NS = SECOND_NS // 4
"""Wait before an unanswered request is sent again [ns]."""
IDLE_NS = SECOND_NS // 2
"""Wait before asking again when there was nothing to lease [ns]."""
RESULTS_MAX = 512
"""Most results in one request: after a long silence they go in portions, see
:data:`schemas.wire.rpc_routes.WORKER_BYTES_MAX`."""
PORTION_MAX = 32
"""Most cases that are asked for at once while they are ``simulator: noop``, which needs no slot."""
BROKEN_PAUSE_MAX_NS = 10 * SECOND_NS
"""Longest pause after rigs that died one after the other [ns]."""
GOODBYE_TRIES = 8
"""Requests without an answer after which a draining worker leaves without a goodbye."""


@dataclass(slots=True)
class Core:
    """State of one worker incarnation."""

    hello: Hello
    until_done: bool = False
    """Leave when the conductor has no case left."""
    drain_ns: int = 0
    """How long running cases may go on after a drain began; 0: they are given back at once [ns]."""
    walltime_end_ns: int | None = None
    """When the worker must be gone, on the clock of the events; None: no end is known [ns]."""
    memory_max_bytes: int | None = None
    """Most memory that the processes of the rig may use together; None: no limit [bytes]."""
    fitting: Callable[[Case], int] | None = None
    """Most slots of a rig for such a case, of those offered; None: all."""
    silence: Silence = field(default_factory=lambda: Silence(None))
    phase: Literal["joining", "working", "finishing", "draining", "left"] = "joining"
    """``finishing``: no new cases, running ones go on; ``draining``: only goodbyes are left."""
    held: dict[int, Held] = field(default_factory=dict)
    results: list[Result] = field(default_factory=list)
    inherited: list[Sealed] = field(default_factory=list)
    """Results of earlier workers, out of the spool."""
    ended: list[Ended] = field(default_factory=list)
    waits: bool = False
    """Whether it waits for a port of this host that another rig uses; no cases are asked for."""
    rig: Rig | None = None
    seq: int = 0
    pending: Next | None = None
    """The NEXT without an answer yet; it is repeated unchanged."""
    asking: bool = False
    """A request is on its way."""
    ask_at_ns: int = 0
    beat_at_ns: int = 0
    ttl_ns: int = 15 * SECOND_NS
    broken: int = 0
    """Rigs that died since the last result."""
    unanswered: int = 0
    refused: int = 0
    """Goodbyes that the conductor refused."""
    reachable: bool = True
    spooled: set[int] = field(default_factory=set)
    """Tokens of results that lie in the spool."""
    drain_reason: Release = "released"
    drain_detail: str = ""
    portion: int = 0
    """So many cases are asked for, whatever the slots: the last ones were all ``noop``."""
    cases_left: bool = True
    """Whether the conductor had cases left when it answered last."""
    drain_until_ns: int = 0

    # --- events -----------------------------------------------------------------------------

    def on_time(self, now_ns: int, said: Callable[[], str] = str) -> list[Effect]:
        """Time has passed: stalled rigs, heartbeats, requests.

        Args:
            now_ns: the time [ns].
            said: the last words of the stack, asked for when a rig stalled.
        """
        effects = self._stalled(now_ns, said) + self._drained(now_ns)
        if self.phase == "left" or self.asking:
            return effects
        request = self._request(now_ns)
        if request is not None:
            self.asking = True
            effects.append(Ask(request))
        return effects

    def on_reply(self, request: Request, reply: Reply | None, now_ns: int) -> list[Effect]:
        """The answer to a request; None: unknown, so it will be sent again."""
        self.asking = False
        if reply is None:
            return self._unanswered(now_ns)
        effects: list[Effect] = []
        self.unanswered = 0
        self.silence.heard()
        if not self.reachable:
            self.reachable = True
            effects.append(Say("conductor is back"))
        if isinstance(request, Hello):
            return effects + self._joined(reply, now_ns)
        if isinstance(request, Bye):
            self.phase = "left"
            return [*effects, Leave()]
        if reply.error:
            return effects + self._refused(reply, now_ns)
        if isinstance(request, Beat):
            for text, touch in request.touched.items():
                held = self.held.get(int(text))
                if held is not None and held.touch == touch:
                    held.told = True
            effects += self._forget(reply.lost, now_ns)
            return effects + (self._asked_to_drain(now_ns) if reply.drain else [])
        assert isinstance(request, Next)
        return effects + self._next_reply(request, reply, now_ns)

    def on_rig_ready(self) -> list[Effect]:
        """Simulator and stack found each other: hand over the leases in hand."""
        if self.rig is None:
            return []
        self.rig.ready = True
        return [AssignLease(held.lease) for held in self.held.values()]

    def on_preparing(self, now_ns: int) -> list[Effect]:
        """Files of the stack are fetched, or kernels are compiled: that is no time of any case."""
        for held in self.held.values():
            held.moved_ns = now_ns
        return []

    def on_progress(
        self,
        tokens: list[int],
        ticks: list[int],
        now_ns: int,
        waiting: Sequence[int] = (),
        over: Sequence[int] = (),
    ) -> list[Effect]:
        """Progress counters from the simulator.

        Args:
            tokens: of the cases that run.
            ticks: of each.
            now_ns: the time [ns].
            waiting: those of ``tokens`` that stand still at somebody's wish.
            over: tokens of cases that have ended and wait for the disk.
        """
        for token, held in self.held.items():
            held.over = token in over
            if held.over:
                held.moved_ns = now_ns
        for token, tick in zip(tokens, ticks, strict=True):
            held = self.held.get(token)
            if held is not None and (tick != held.progress or token in waiting):
                held.progress = tick
                held.moved_ns = now_ns
        return []

    def on_done(self, result: Result, now_ns: int) -> list[Effect]:
        """A case ended; its result waits for the next request, which is due now."""
        if (held := self.held.pop(result.token, None)) is None:
            return []  # abandoned meanwhile
        self.silence.ran(result.token, held.began_ns, now_ns)
        self.results.append(result)
        self.broken = 0
        self.ask_at_ns = now_ns
        effects = [] if self.reachable else self._spool([result])
        if self.rig is not None and self.rig.faulty and not self.held:
            self.rig = None
            effects.append(StopRig())
        return effects

    def on_intervened(self, token: int, touch: Touch, now_ns: int) -> list[Effect]:
        """An intervention in a case has begun; the conductor hears of it at once."""
        held = self.held.get(token)
        if held is not None:
            held.touch, held.told = touch, False
            self.beat_at_ns = now_ns
        return []

    def on_intervened_done(self, result: Result, changes: int, now_ns: int) -> list[Effect]:
        """A case that an intervention has changed ended: it goes back, uncharged."""
        held = self.held.pop(result.token, None)
        if held is None:
            return []  # abandoned meanwhile
        detail = (
            f"steered by hand, {changes} changes, ended with '{result.verdict or result.outcome}'; "
            f"{JOURNAL_FILE} and kpi {result.kpi_sha256[:12]} are in its folder"
        )
        self.ended.append(held.ended("intervened", detail))
        self.broken = 0
        self.ask_at_ns = now_ns
        return []

    def on_spool(self, contents: list[bytes]) -> list[Effect]:
        """Results that earlier incarnations left behind are delivered with the next request."""
        results = [sealed for data in contents if (sealed := unpack(data)) is not None]
        self.inherited += results
        damaged = len(contents) - len(results)
        effects: list[Effect] = []
        if results:
            effects.append(Say(f"{len(results)} results of earlier workers are delivered"))
        if damaged:
            effects.append(Say(f"{damaged} files of the spool are damaged and ignored"))
        return effects

    def on_stack_failed(self, reason: str, now_ns: int, *, left: bool = False) -> list[Effect]:
        """The stack raised, broke the protocol or left by itself, which it would do again.

        That is the outcome of a case that was alone with it. Of several each may be the reason:
        they are suspects, as when a rig dies. On a GPU another rig may be the reason, unless this
        one is apart. Before any case began it is the outcome of all that wait for the stack.

        Args:
            reason: what it said last, in a line.
            now_ns: the time [ns].
            left: its process ended. A scheduler that ends a job may have asked for that.
        """
        if self.rig is None or self.rig.faulty:
            return []
        running = [held for held in self.held.values() if not held.over]
        if left and self.phase != "working":
            return self.on_rig_died("released", reason, now_ns)
        several = self.rig.ready and len(running) > 1
        suspect = several or (self._on_gpu and not all(held.lease.alone for held in running))
        if suspect or not running:
            return self.on_rig_died("crash", reason, now_ns)
        self.rig.faulty = True
        line = Say(f"rig ended (failed): {reason}")
        for held in running:
            held.moved_ns = now_ns
        if self.rig.ready:
            return [line, FailCase(running[0].lease.token, reason)]
        return [line, FailUnbegun(tuple(held.lease for held in running), reason)]

    def on_port_taken(self, port: int, now_ns: int) -> list[Effect]:
        """A rig cannot be started: its script listens where that of another rig of this host does.

        Its cases go back uncharged; until :meth:`on_port_free` nothing is asked for.
        """
        line = f"waits for port {port}, which another rig of this host uses"
        for held in self.held.values():
            self.ended.append(held.ended("released", line))
        self.held.clear()
        self.rig, self.waits = None, True
        self.ask_at_ns = now_ns
        return [Say(f"{line}; scripts that listen elsewhere need no turns: parameters.port")]

    def on_port_free(self, now_ns: int) -> list[Effect]:
        """The other rig has ended."""
        self.waits = False
        self.ask_at_ns = now_ns
        return []

    def on_rig_died(self, reason: Release, detail: str, now_ns: int) -> list[Effect]:
        """The rig ended by itself: one case alone is charged, several are suspects.

        On a GPU a rig may end because of another one, unless it is apart.

        ``released``: it was the host that had no room for a rig, ``refused``: a file is not what
        the campaign was submitted with; no case is to blame.
        """
        several = sum(not held.over for held in self.held.values()) > 1
        for held in self.held.values():
            suspect = several or (self._on_gpu and not held.lease.alone)
            blames = reason not in ("released", "refused")
            why: Release = "suspect" if suspect and blames else reason
            if held.over:
                why = "released"  # it had ended; only its result is lost
            if held.touch is not None and held.touch.changes:
                why = "intervened"  # which may have been the reason
            self.ended.append(held.ended(why, detail))
        kept = (
            self._keep_logs(f"{reason}: {detail}") if reason not in ("released", "refused") else []
        )
        self.held.clear()
        self.rig = None
        self.broken += 1
        pause_ns = min(BROKEN_PAUSE_MAX_NS, RETRY_NS * 2**self.broken)
        self.ask_at_ns = now_ns + (pause_ns if self.broken > 1 else 0)
        return [*kept, StopRig(), Say(f"rig ended ({reason}): {detail}")]

    def on_memory(self, used: dict[str, int], now_ns: int) -> list[Effect]:
        """What the processes of the rig use [bytes]."""
        if self.rig is None or not (detail := over_memory(used, self.memory_max_bytes)):
            return []
        return self.on_rig_died("out_of_memory", detail, now_ns)

    def on_drain(self, detail: str, now_ns: int, reason: Release = "released") -> list[Effect]:
        """Take no new cases and leave; running ones may go on for ``drain_ns``.

        A second call while they do gives them back at once.
        """
        if self.phase in ("draining", "left"):
            return []
        if self.phase == "joining":
            return [*self._end_all("released", detail), *self.leave()]
        if self.phase == "finishing":
            return self._release(now_ns)
        self.phase = "finishing"
        self.drain_reason, self.drain_detail = reason, detail
        self.drain_until_ns = now_ns + self.drain_ns
        if self.walltime_end_ns is not None:
            self.drain_until_ns = min(self.drain_until_ns, max(self.walltime_end_ns, now_ns))
        effects = self._drained(now_ns)
        if self.phase == "finishing":
            limit_s = (self.drain_until_ns - now_ns) / SECOND_NS
            effects.append(
                Say(f"{detail}: {counted(len(self.held), 'case')} may end within {limit_s:g} s")
            )
        return effects

    # --- decisions --------------------------------------------------------------------------

    def _drained(self, now_ns: int) -> list[Effect]:
        """Walltime and the end of a drain."""
        effects: list[Effect] = []
        if self.phase == "working" and self.walltime_end_ns is not None:
            if now_ns < self.walltime_end_ns - self.drain_ns:
                return []
            return self.on_drain("the walltime ends", now_ns, "walltime")
        if self.phase == "finishing" and (not self.held or now_ns >= self.drain_until_ns):
            effects += self._release(now_ns)
        return effects

    def _release(self, now_ns: int) -> list[Effect]:
        self.phase = "draining"
        self.ask_at_ns = now_ns
        held = len(self.held)
        returned = f"{counted(held, 'case')} {agree(held, 'is', 'are')} given back"
        line = Say(f"{self.drain_detail}: leaving, {returned}")
        return [line, *self._end_all(self.drain_reason, self.drain_detail)]

    def _end_all(self, reason: Release, detail: str) -> list[Effect]:
        """Give every case back and stop the rig."""
        for held in self.held.values():
            self.ended.append(held.ended(reason, detail))
        kept = self._keep_logs(f"{reason}: {detail}")
        self.held.clear()
        effects: list[Effect] = [*kept, StopRig()] if self.rig else []
        self.rig = None
        return effects

    def _keep_logs(self, end: str) -> list[Effect]:
        """Logs are kept of the held attempts, which end without a result; those of cases that are
        over have one on the way."""
        leases = tuple(held.lease for held in self.held.values() if not held.over)
        return [KeepLogs(leases, end)] if leases and self.rig is not None else []

    def _asked_to_drain(self, now_ns: int) -> list[Effect]:
        if self.phase != "working":
            return []
        return self.on_drain("conductor asked to drain", now_ns)

    def leave(self, error: str = "", silent: str = "") -> list[Effect]:
        """Leave without a goodbye; what was not delivered waits in the spool."""
        self.phase = "left"
        return [*self._spool(self.results), Leave(error, silent)]

    def _spool(self, results: list[Result]) -> list[Effect]:
        fresh = [result for result in results if result.token not in self.spooled]
        self.spooled |= {result.token for result in fresh}
        return [SpoolWrite(result.token, pack(result, self.hello)) for result in fresh]

    def _request(self, now_ns: int) -> Request | None:
        if now_ns < self.ask_at_ns:
            return self._beat(now_ns)
        if self.phase == "joining":
            return self.hello
        news = self.results or self.inherited or self.ended
        if self.pending is None and (news or self._free() > 0):
            self.seq += 1
            self.pending = Next(
                v=SCHEMA_VERSION,
                worker=self.hello.worker,
                seq=self.seq,
                k=self._wanted(),
                rig=self.rig.key if self.rig else "",
                results=self.results[:RESULTS_MAX],
                ended=self.ended[:],
                held=list(self.held),
                remaining_s=self._remaining_s(now_ns),
                session=self.hello.session,
                sealed=self.inherited[:SEALED_MAX],
            )
        if self.pending is not None:
            return self.pending
        if self.phase == "draining":
            return Bye(v=SCHEMA_VERSION, worker=self.hello.worker, session=self.hello.session)
        return self._beat(now_ns)

    def _beat(self, now_ns: int) -> Beat | None:
        if self.phase not in ("working", "finishing") or now_ns < self.beat_at_ns:
            return None
        if not self.reachable:
            return None
        self.beat_at_ns = now_ns + self.ttl_ns // 4
        progress = {str(token): held.progress for token, held in self.held.items()}
        touched = {str(t): h.touch for t, h in self.held.items() if h.touch and not h.told}
        return Beat(
            v=SCHEMA_VERSION,
            worker=self.hello.worker,
            held=progress,
            touched=touched,
            session=self.hello.session,
        )

    def _remaining_s(self, now_ns: int) -> float | None:
        if self.walltime_end_ns is None:
            return None
        return max(0.0, (self.walltime_end_ns - self.drain_ns - now_ns) / SECOND_NS)

    def _free(self) -> int:
        if self.phase != "working" or self.waits or (self.rig is not None and self.rig.faulty):
            return 0
        if any(held.lease.alone for held in self.held.values()):
            return 0
        slots = self.rig.slots if self.rig else self.hello.slots
        return max(0, slots - len(self.held))

    def _wanted(self) -> int:
        """Number of cases to ask for: one per free slot, or a portion of those that need none."""
        free = self._free()
        return max(free, self.portion) if free and self.rig is None else free

    def _joined(self, reply: Reply, now_ns: int) -> list[Effect]:
        if reply.error and reply.retry_after_s:
            # It knows no harm of us, it cannot write just now.
            self.ask_at_ns = now_ns + max(int(reply.retry_after_s * SECOND_NS), IDLE_NS)
            return [Say(f"conductor: {reply.error}")]
        if reply.error:
            return [*self._end_all("released", reply.error), *self.leave(reply.error)]
        if self.phase == "joining":
            self.phase = "working"
        self.ttl_ns = max(SECOND_NS // 10, int(reply.ttl_s * SECOND_NS))
        self.ask_at_ns = now_ns
        self.beat_at_ns = now_ns + self.ttl_ns // 4
        return []

    def _refused(self, reply: Reply, now_ns: int) -> list[Effect]:
        """The conductor does not know us (its journal is older) or cannot write: try again."""
        effects: list[Effect] = [Say(f"conductor: {reply.error}")]
        self.ask_at_ns = now_ns + IDLE_NS
        if "hello" in reply.error and self.phase == "working":
            self.phase = "joining"
        if self.phase == "draining":
            self.refused += 1
            if self.refused >= GOODBYE_TRIES:
                return effects + self.leave()
        return effects

    def _unanswered(self, now_ns: int) -> list[Effect]:
        self.unanswered += 1
        self.ask_at_ns = now_ns + RETRY_NS
        if self.phase == "draining" and self.unanswered >= GOODBYE_TRIES:
            return self.leave()
        if (line := self.silence.is_over(now_ns)) and not self.held:
            return self.leave(silent=line)
        if self.reachable and self.unanswered > 1:
            self.reachable = False
            line = Say("conductor does not answer; cases go on, results wait")
            return [line, *self._spool(self.results)]
        return []

    def _next_reply(self, request: Next, reply: Reply, now_ns: int) -> list[Effect]:
        if self.pending is None or request.seq != self.pending.seq:
            return []  # an older repeat
        self.pending = None
        self.silence.settled(request.results)
        settled = [r.token for r in request.results if r.token in self.spooled]
        self.spooled.difference_update(settled)
        settled += [sealed.token for sealed in request.sealed]
        self.inherited = self.inherited[len(request.sealed) :]
        self.results = self.results[len(request.results) :]
        self.ended = self.ended[len(request.ended) :]
        effects: list[Effect] = [SpoolForget(token) for token in settled]
        effects += self._forget(reply.lost, now_ns)
        self.cases_left = reply.left != 0
        if reply.drain or (self.until_done and reply.left == 0 and not reply.leases):
            effects += self._asked_to_drain(now_ns)
        if self.phase != "working":
            # Granted while we were about to leave: hand them back.
            self.ended += [Held(lease).ended("released", "worker leaves") for lease in reply.leases]
            return effects
        if strange := {granted.case_version for granted in reply.leases} - {CASE_VERSION}:
            why = (
                f"the conductor leases cases of version {max(strange)}, this worker reads version "
                f"{CASE_VERSION}; install the same release on both sides"
            )
            return [*effects, *self._end_all("released", why), *self.leave(why)]
        if self._free() and not reply.leases:
            self.ask_at_ns = now_ns + int(max(reply.retry_after_s * SECOND_NS, IDLE_NS))
        return effects + self._accept(reply.leases, now_ns)

    def _accept(self, leases: list[Lease], now_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        noops = sum(lease.case.rig.simulator == "noop" for lease in leases)
        self.portion = min(2 * noops, PORTION_MAX) if noops == len(leases) else 0
        for lease in leases:
            if lease.case.rig.simulator == "noop":
                self.results.append(noop_result(lease))
                self.ask_at_ns = now_ns
                continue
            if self.rig is not None and self.rig.faulty:
                why = "the stack of the rig has failed"
                self.ended.append(Held(lease).ended("released", why))
                self.ask_at_ns = now_ns
                continue
            key = rig_key(lease.case)
            if self.rig is not None and (self.rig.key != key or lease.alone or self.rig.apart):
                assert not self.held, "a lease of another rig came while cases were running"
                effects.append(StopRig())
                self.rig = None
            if self.rig is None:
                self.rig = Rig(key, self._slots_of(lease.case), lease.alone and self._on_gpu)
                effects.append(StartRig(lease, self.rig.slots))
            elif len(self.held) >= self.rig.slots:
                # Asked for before its rig was known: it may hold fewer cars than were offered.
                why = f"the rig drives {self.rig.slots} at once"
                self.ended.append(Held(lease).ended("released", why))
                self.ask_at_ns = now_ns
                continue
            elif self.rig.ready:
                effects.append(AssignLease(lease))
            self.held[lease.token] = Held(lease, moved_ns=now_ns, began_ns=now_ns)
        return effects

    @property
    def _on_gpu(self) -> bool:
        return self.hello.device_class.startswith("cuda")

    def _slots_of(self, case: Case) -> int:
        slots = case.rig.slots_of(self.hello.slots)
        return slots if self.fitting is None else max(1, min(slots, self.fitting(case)))

    def _forget(self, lost: list[int], now_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        for token in lost:
            if self.held.pop(token, None) is not None:
                effects.append(AbandonToken(token))
                self.ask_at_ns = now_ns
        return effects

    def _stalled(self, now_ns: int, last_words: Callable[[], str]) -> list[Effect]:
        for held in self.held.values():
            deadline_s = held.lease.case.variation.deadline_s
            deadline_ns = int(deadline_s * SECOND_NS)
            if now_ns - held.moved_ns >= deadline_ns:
                detail = (
                    f"case {held.lease.case.id}: no progress for {deadline_s:g} s "
                    f"at tick {max(held.progress, 0)}{last_words()}"
                )
                return self.on_rig_died("deadline", detail, now_ns)
        return []
