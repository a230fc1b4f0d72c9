"""A worker of the swarm: incarnation after incarnation, with a spool and a stubborn client."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from conductor_bench import S, beat_of, hello, result, secret, shown

from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.control import Bye, Ended, Lease, Next, Reply, Result, Sealed
from twin.fabric.session import seal

if TYPE_CHECKING:
    from conductor_swarm import Swarm


class Worker:
    """One place for workers: incarnation after incarnation, until one leaves in peace."""

    def __init__(self, swarm: Swarm, place: str) -> None:
        self.swarm = swarm
        self.place = place
        self.incarnation = 0
        self.name = place
        self._spool: list[Sealed] = []
        self._reset()

    def boot(self) -> None:
        """A new incarnation."""
        self.incarnation += 1
        self.name = f"{self.place}-{self.incarnation}"
        self._reset()
        if self.swarm.random.random() < 0.5:  # otherwise it starts on another disk
            self._sealed = self._spool
            self.swarm.counts["spooled"] += len(self._spool)
        self._spool = []
        self._after(0, self._say_hello)
        self._after(S, self._live)

    def hear(self, name: str, data: bytes) -> None:
        """A reply to ``name`` arrives, perhaps late, perhaps twice."""
        if name != self.name or self.place == "submitter":
            return
        reply = decode(data, Reply)
        if self.swarm.now_ns < self._frozen_until_ns:
            self._after(0, lambda: self.hear(name, data))
            return
        if reply.error:
            if "hello" in reply.error or "has left" in reply.error:
                assert name in self.swarm.oracle.left, f"{name} was forgotten"
                self._gone()
            return
        if reply.drain and self._joined and not self._held and not (self._results or self._sealed):
            self.swarm.counts["drained"] += 1
            self.swarm.ask(self, encode(shown(Bye(v=V, worker=self.name))))
            self._gone()
            return
        for token in reply.lost:
            self._held.pop(token, None)
            self._results = [r for r in self._results if r.token != token]
        if not self._joined:
            self._joined = True
            self._after(0, self._beat)
            self._after(0, self._next)
        elif self._pending is not None and reply.seq == self._pending.seq:
            self._answered(reply, self._pending)

    def _reset(self) -> None:
        self._joined = False
        self._seq = 0
        self._held: dict[int, Lease] = {}
        self._results: list[Result] = []
        self._sealed: list[Sealed] = []
        self._ended: list[Ended] = []
        self._pending: Next | None = None
        self._frozen_until_ns = 0

    def _after(self, delay_ns: int, action: Callable[[], None]) -> None:
        """Later, if this incarnation still lives and is not frozen then."""
        incarnation = self.incarnation

        def act() -> None:
            if self.incarnation != incarnation:
                return
            if self.swarm.now_ns < self._frozen_until_ns:
                self.swarm.after(self._frozen_until_ns - self.swarm.now_ns, act)
            else:
                action()

        self.swarm.after(delay_ns, act)

    def _live(self) -> None:
        swarm = self.swarm
        if swarm.chance("worker_crash"):
            if swarm.random.random() < 0.5:
                swarm.ask(self, b"", vanished=self.name)
            self._gone()
            return
        if swarm.chance("worker_freeze"):
            self._frozen_until_ns = swarm.now_ns + swarm.random.randint(S, 20 * S)
        if swarm.faulty and self._joined and swarm.random.random() < 0.01:
            swarm.counts["byes"] += 1
            swarm.ask(self, encode(shown(Bye(v=V, worker=self.name))))
            self._gone()
            return
        self._after(S, self._live)

    def _gone(self) -> None:
        """Nothing that is under way reaches this incarnation any more. Its results are spooled."""
        pending = self._pending
        own = [*self._results, *(pending.results if pending else [])]
        self._spool = [*self._sealed, *(pending.sealed if pending else [])]
        self._spool += [_sealed(result, self.name) for result in own]
        self.incarnation += 1
        self.name = ""
        self.swarm.after(self.swarm.random.randint(S, 8 * S), self.boot)

    def _say_hello(self) -> None:
        if not self._joined:
            self.swarm.ask(self, encode(hello(self.name, host=self.place)))
            self._after(S, self._say_hello)

    def _beat(self) -> None:
        tokens = [*self._held, *(r.token for r in self._results), *(e.token for e in self._ended)]
        if self._pending is not None:
            tokens += [r.token for r in self._pending.results]
        self.swarm.ask(self, encode(beat_of(self.name, {str(token): 1 for token in tokens})))
        self._after(self.swarm.config.ttl_ns // 4, self._beat)

    def _next(self) -> None:
        """Ask, or ask again with the same seq."""
        if self._pending is None:
            self._seq += 1
            self._pending = Next(
                v=V,
                worker=self.name,
                seq=self._seq,
                k=3 - len(self._held),
                results=self._results,
                ended=self._ended,
                held=list(self._held),
                sealed=self._sealed,
            )
            self._results, self._ended, self._sealed = [], [], []
        seq = self._seq
        self.swarm.ask(self, encode(shown(self._pending)))
        self._after(S, lambda: self._next() if self._pending and self._seq == seq else None)

    def _answered(self, reply: Reply, request: Next) -> None:
        self._pending = None
        told = (*request.results, *request.sealed)
        assert set(reply.acks) == {each.token for each in told}, "a result without an answer"
        for lease in reply.leases:
            self._held[lease.token] = lease
            self._after(
                self.swarm.random.randint(S // 5, 4 * S),
                lambda t=lease.token: self._finish(t),  # type: ignore[misc]
            )
        self._after(self.swarm.random.randint(S // 20, S), self._next)

    def _finish(self, token: int) -> None:
        lease = self._held.pop(token, None)
        if lease is None:
            return
        swarm = self.swarm
        if lease.case.id in swarm.kills_worker:
            swarm.counts["poisoned_workers"] += 1
            swarm.ask(self, b"", vanished=self.name)
            self._gone()
        elif lease.case.id in swarm.kills_rig or swarm.chance("rig_death"):
            self._rig_died({token: lease, **self._held})
        elif swarm.chance("attempt"):
            self._give_up(lease, swarm.random.choice(["walltime", "released"]))
        else:
            wall_s = swarm.random.uniform(0.2, 4.0)
            self._results.append(result(lease, wall_s=wall_s))

    def _rig_died(self, leases: dict[int, Lease]) -> None:
        several = len(leases) > 1
        self.swarm.counts["rigs_died_with_several"] += several
        reason = "suspect" if several else self.swarm.random.choice(["crash", "deadline"])
        for lease in leases.values():
            self._give_up(lease, reason)
        self._held.clear()

    def _give_up(self, lease: Lease, reason: str) -> None:
        self._ended.append(
            Ended(campaign="alpha", case=lease.case.id, token=lease.token, reason=reason)  # type: ignore[arg-type]
        )


def _sealed(result: Result, worker: str) -> Sealed:
    data = encode(result)
    return Sealed(result.token, worker, data, seal(secret(worker), data))
