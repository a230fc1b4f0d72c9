"""What a front lets through: how many connections, messages and bytes. Pure: the time comes in."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass, field

from twin.fabric.keys.roles import Role

HANDSHAKE_S = 5.0
"""How long a handshake may take [s]."""
FIRST_WORD_S = 10.0
"""How long a member may stay silent after its handshake [s]."""
SHAKING_MAX = 256
"""Most handshakes under way; one more ends the oldest, and an honest one takes milliseconds."""
SHAKING_PER_ADDRESS_MAX = 64
"""Most of them from one address; one more ends the oldest of that address."""
BURST_S = 2.0
"""A key may be ahead of its rates by what it may do in this time [s]."""


@dataclass(frozen=True, slots=True)
class Quota:
    """What all connections of one key may do together."""

    connections: int
    messages_per_s: float
    """Batches of Zenoh; a request is one."""
    bytes_per_s: float
    """Towards the conductor [bytes/s]."""


QUOTAS: dict[Role, Quota] = {
    Role.conductor: Quota(256, 100_000, 1 << 30),
    Role.worker: Quota(8_192, 50_000, 512 << 20),
    Role.viewer: Quota(512, 2_000, 16 << 20),
}
"""Role -> quota of each of its keys. A fabric's workers may all have one key; the conductor's is
that of relays, which pass on for whole clusters."""

OTHERS = Quota(128, 2_000, 64 << 20)
"""Quota of keys of any other role."""


def quota_of(role: Role) -> Quota:
    """What a key of ``role`` may do."""
    return QUOTAS.get(role, OTHERS)


@dataclass(slots=True)
class Bucket:
    """Tokens that come at a rate. What is taken is taken: a debt is waited for afterwards."""

    per_s: float
    burst_s: float = BURST_S
    """Time whose allowance may be taken at once [s]."""
    level: float = field(init=False)
    then_s: float = 0.0

    def __post_init__(self) -> None:
        self.level = self.per_s * self.burst_s

    def take(self, count: float, now_s: float) -> float:
        """Take ``count``; how long to wait before anything more is taken [s]."""
        came = max(0.0, now_s - self.then_s) * self.per_s
        self.level = min(self.per_s * self.burst_s, self.level + came) - count
        self.then_s = max(self.then_s, now_s)
        return max(0.0, -self.level / self.per_s)

    def has(self, count: float, now_s: float) -> bool:
        """Take ``count`` if it is there."""
        self.take(0.0, now_s)
        if self.level < count:
            return False
        self.level -= count
        return True


@dataclass(slots=True)
class Account:
    """What the connections of one key have done."""

    quota: Quota
    connections: int = 0
    messages: Bucket = field(init=False)
    bytes: Bucket = field(init=False)

    def __post_init__(self) -> None:
        self.messages = Bucket(self.quota.messages_per_s)
        self.bytes = Bucket(self.quota.bytes_per_s)

    def take(self, messages: int, size: int, now_s: float) -> float:
        """Count what came in; returns how long to wait before more is read [s]."""
        return max(self.messages.take(messages, now_s), self.bytes.take(size, now_s))


class Batches:
    """Counts Zenoh's batches in a stream: each begins with its length, two bytes."""

    def __init__(self) -> None:
        self._left = 0
        self._first = b""

    def count(self, data: bytes) -> int:
        """Number of batches that begin in the next ``data`` of the stream."""
        begun, at, size = 0, 0, len(data)
        while True:
            at += self._left
            if at >= size:
                self._left = at - size
                return begun
            self._left = 0
            head = self._first + data[at : at + 2 - len(self._first)]
            at += len(head) - len(self._first)
            self._first = head
            if len(head) < 2:
                return begun
            begun += 1
            self._left, self._first = int.from_bytes(head, "little"), b""


class HandshakeSlots:
    """Handshakes under way; none is refused, the oldest makes room instead."""

    def __init__(self) -> None:
        self._all: OrderedDict[Hashable, str] = OrderedDict()
        self._at: dict[str, OrderedDict[Hashable, None]] = {}

    def __len__(self) -> int:
        return len(self._all)

    def take(self, who: Hashable, address: str) -> Hashable | None:
        """``who`` begins at ``address``; whose slot it takes, if all are taken."""
        here = self._at.get(address, OrderedDict())
        oldest: Hashable | None = None
        if len(here) >= SHAKING_PER_ADDRESS_MAX:
            oldest = next(iter(here))
        elif len(self._all) >= SHAKING_MAX:
            oldest = next(iter(self._all))
        if oldest is not None:
            self.free(oldest)
        self._all[who] = address
        self._at.setdefault(address, OrderedDict())[who] = None
        return oldest

    def free(self, who: Hashable) -> None:
        """``who`` is through, or gone."""
        address = self._all.pop(who, None)
        if address is not None:
            here = self._at[address]
            del here[who]
            if not here:
                del self._at[address]
