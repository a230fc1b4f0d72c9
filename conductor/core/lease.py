"""Leases: tokens, expiry, and what each way of losing one means for its case."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from conductor.core.facts import Seen
from conductor.core.state import FAR_NS, LiveLease, State
from schemas.wire.control import Release

TOKENS_PER_EPOCH = 2**32
"""Tokens of a later epoch are larger than all tokens of earlier ones."""


def token_of(epoch: int, count: int) -> int:
    """Fencing token number ``count`` (from 1) of ``epoch``."""
    if not 0 < count < TOKENS_PER_EPOCH:
        raise AssertionError(f"lease {count} of one epoch")
    return epoch * TOKENS_PER_EPOCH + count


@dataclass(frozen=True, slots=True)
class Policy:
    """What the end of an attempt means for its case."""

    charged: bool
    alone: bool
    """The next lease runs alone."""


# A case that killed its rig is tried alone next: if it does so again, no neighbour suffers.
POLICIES: dict[Release, Policy] = {
    "released": Policy(charged=False, alone=False),
    "walltime": Policy(charged=False, alone=False),
    "lost": Policy(charged=False, alone=False),
    "intervened": Policy(charged=False, alone=False),
    "refused": Policy(charged=False, alone=False),
    "suspect": Policy(charged=False, alone=True),
    "crash": Policy(charged=True, alone=True),
    "deadline": Policy(charged=True, alone=True),
    "out_of_memory": Policy(charged=True, alone=True),
}


def expired(state: State, now_ns: int) -> list[LiveLease]:
    """Live leases whose time is over; a lease that expires now has expired."""
    if now_ns < state.expiry_floor_ns:
        return []
    return [lease for lease in state.leases.values() if lease.expiry_ns <= now_ns]


def next_expiry_ns(state: State) -> int:
    """No live lease expires before this; FAR_NS without leases. Cheap [ns]."""
    return state.expiry_floor_ns if state.leases else FAR_NS


def first_expiry_ns(state: State) -> int:
    """When the first live lease expires; FAR_NS without leases; looks at all of them [ns]."""
    return min((lease.expiry_ns for lease in state.leases.values()), default=FAR_NS)


def own(state: State, worker: str, tokens: Iterable[int]) -> list[LiveLease]:
    """The live leases of ``worker`` among ``tokens``."""
    leases = state.leases
    return [
        lease
        for token in tokens
        if (lease := leases.get(token)) is not None and lease.worker == worker
    ]


def lost(state: State, worker: str, tokens: Iterable[int]) -> list[int]:
    """Tokens of ``tokens`` that are no live leases of ``worker``."""
    live = {lease.token for lease in own(state, worker, tokens)}
    return [token for token in tokens if token not in live]


def seen(
    state: State,
    worker: str,
    tokens: Iterable[int],
    now_ns: int,
    progress: dict[int, int] | None = None,
    remaining_s: float | None = None,
) -> Seen:
    """The worker spoke of ``tokens``: its own live ones among them get a full time to live."""
    live = [lease.token for lease in own(state, worker, tokens)]
    return Seen(
        worker=worker,
        now_ns=now_ns,
        until_ns=now_ns + state.config.ttl_ns,
        tokens=live,
        progress={token: progress[token] for token in live} if progress else {},
        remaining_s=remaining_s,
    )
