"""Leases that a worker holds, the rig that runs them, and its patience with its conductor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from schemas.wire.control import Ended, Lease, Release, Result, Touch
from schemas.words import counted


@dataclass(frozen=True, slots=True)
class CampaignWork:
    """Cases of one campaign that the worker holds."""

    out: str
    """Campaign folder."""
    cases: int
    batch: int
    """Batch of all of them; 0: none, or several."""


@dataclass(slots=True)
class Held:
    """Lease that the worker holds."""

    lease: Lease
    progress: int = -1
    moved_ns: int = 0
    """Time at which progress was last seen [ns]."""
    began_ns: int = 0
    """Time at which it was granted [ns]."""
    touch: Touch | None = None
    """Last intervention in it."""
    told: bool = True
    """The conductor knows."""
    over: bool = False
    """The case has ended; its result is on the way to the disk."""

    def ended(self, reason: Release, detail: str) -> Ended:
        """End of the attempt, without a result."""
        case = self.lease.case
        return Ended(case.variation.campaign, case.id, self.lease.token, reason, detail[:500])


@dataclass(slots=True)
class Rig:
    """The running rig."""

    key: str
    slots: int
    """Cases that it drives at once."""
    apart: bool = False
    """Whether the rig shares its GPU in turns, for the sake of one case; others get another rig."""
    ready: bool = False
    faulty: bool = False
    """Whether the stack has failed by itself: the rig ends when the results are there."""


@dataclass(slots=True)
class Silence:
    """Time since the conductor was heard last, and what a worker has in hand for it.

    A conductor that has ended its campaign does not come back. A worker that missed that end, since
    it stood still or its network did, would wait for it until its walltime, and keep its processor.
    """

    limit_ns: int | None
    """A worker with nothing in hand leaves after so long; None: it waits as long as it may live
    [ns]."""
    since_ns: int | None = None
    """First request without an answer; None: the conductor answers [ns]."""
    until_ns: dict[int, int] = field(default_factory=dict)
    """Token -> time until which the result of a case is waited for [ns]."""

    def heard(self) -> None:
        """The conductor has answered something."""
        self.since_ns = None

    def ran(self, token: int, began_ns: int, now_ns: int) -> None:
        """A case that began at ``began_ns`` has ended now, with a result."""
        self.until_ns[token] = now_ns + (now_ns - began_ns)

    def settled(self, results: Iterable[Result]) -> None:
        """The conductor has these results."""
        for result in results:
            self.until_ns.pop(result.token, None)

    def is_over(self, now_ns: int) -> str:
        """Why nobody is waited for any longer, in a line; empty: a request without an answer is
        repeated.

        A result in hand is waited for, from the end of its case, as long as it took to make it:
        afterwards it costs less to run the case again, on this processor or another.
        """
        if self.since_ns is None:
            self.since_ns = now_ns
        if self.limit_ns is None:
            return ""
        if now_ns < max([self.since_ns + self.limit_ns, *self.until_ns.values()]):
            return ""
        left = len(self.until_ns)
        lost = f"; {counted(left, 'result')} not delivered" if left else ""
        return f"no conductor has answered for {(now_ns - self.since_ns) / 1e9:.0f} s{lost}"


def over_memory(used: dict[str, int], limit_bytes: int | None) -> str:
    """What the processes of a rig use [bytes], in a line; empty: no more than they may."""
    total = sum(used.values())
    if limit_bytes is None or total <= limit_bytes:
        return ""
    parts = ", ".join(f"{name} {size / 1e9:.2f}" for name, size in used.items())
    return (
        f"the rig uses {total / 1e9:.2f} GB of memory ({parts}), allowed are {limit_bytes / 1e9:g}"
    )
