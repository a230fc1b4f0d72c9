"""Who owns a store's journal: claims, numbered from 1, of which each is won by one conductor.

```
owner/000001        the first owner, its epoch
owner/000002        its successor; who finds this one after its own has to end
journal/000002/head where the second owner's journal stands
```

A claim is made by creating an object that must not be there, the only operation of a store that
needs a winner. StoreClaims are never removed, so a conductor that was frozen for days finds its
successor. Listings may be stale: the numbers after the last listed one are asked for by name.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

import msgspec
from msgspec import Struct

from conductor.journal.owner import FolderOwner
from conductor.stored.seals import StoreSeal
from twin.base.errors import UsageError
from twin.stores.protocol import DamagedObjectError, MissingObjectError, ResultStore

RECORD_BYTES_MAX = 1 << 14
"""Largest record of an owner [bytes]."""
STALE_S = 15.0
"""A successor watches an owner so long before it takes over [s]; as a lease's time to live."""
LOOK_S = 0.5
"""How often it looks [s]."""


class StoreOwner(Struct, frozen=True):
    """One claim."""

    claim: int
    epoch: int
    """Epoch of its tokens: larger than that of all earlier claims."""
    owner: FolderOwner
    lease: str
    """Id of the state folder, which a restart on the same folder knows."""


class StoreClaims:
    """The claims of one store.

    Args:
        store: the store.
        seal: marks its records.
    """

    def __init__(self, store: ResultStore, seal: StoreSeal) -> None:
        self._store, self._seal = store, seal

    def latest(self) -> tuple[int, StoreOwner | None]:
        """Number of the latest claim, 0 if there is none; and the latest that can be read.

        Raises:
            OtherKeyError: a claim was made with another key.
            TwinError: the store does not answer.
        """
        numbers = [_number(name) for name in self._store.names("owner/")]
        number = max(numbers, default=0)
        while self.exists(number + 1):
            number += 1
        for earlier in range(number, 0, -1):
            try:
                return number, self.read(earlier)
            except (DamagedObjectError, MissingObjectError):
                continue  # its writer was told that it lost, and took the next number
        return number, None

    def read(self, number: int) -> StoreOwner:
        """A claim by its number.

        Raises:
            OtherKeyError, DamagedObjectError: it cannot be believed.
            TwinError: it is not there, or the store does not answer.
        """
        content = self._seal.read(_name(number), RECORD_BYTES_MAX)
        try:
            return msgspec.json.decode(content, type=StoreOwner)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            raise DamagedObjectError(f"{self._store.url}/{_name(number)}: damaged") from None

    def exists(self, number: int) -> bool:
        """Whether somebody has claimed under this number; by its name, never by a listing."""
        try:
            self._store.get(_name(number), RECORD_BYTES_MAX)
        except MissingObjectError:
            return False
        except DamagedObjectError:
            pass
        return True

    def claim(self, number: int, epoch: int, owner: FolderOwner, lease: str) -> StoreOwner:
        """Make the claim ``number``, or the next one if that was written by halves.

        Raises:
            UsageError: another conductor was faster.
            TwinError: the store does not answer.
        """
        while True:
            made = StoreOwner(number, epoch, owner, lease)
            if self._store.create(
                _name(number), self._seal.marked(_name(number), msgspec.json.encode(made))
            ):
                return made
            try:
                other = self.read(number)
            except DamagedObjectError:
                number += 1
                continue
            raise UsageError(f"{self._store.url}: {taken_by(other)} at the same time; it serves")


def taken_by(owner: StoreOwner | None) -> str:
    """Who has taken a store over, for people."""
    if owner is None:
        return "taken over by another conductor"
    return f"taken over by the conductor (pid {owner.owner.pid} on {owner.owner.host})"


def await_silence(
    look: Callable[[], bytes], in_use: str, stale_s: float, clock: Callable[[], float]
) -> None:
    """Return when what ``look`` sees has stood still for ``stale_s``, by our clock alone.

    Raises:
        UsageError: it has moved: ``in_use``.
    """
    seen, since_s = look(), clock()
    while clock() - since_s < stale_s:
        time.sleep(LOOK_S)
        if look() != seen:
            raise UsageError(in_use)


def restarted(found: FolderOwner, me: FolderOwner) -> bool:
    """Whether the scheduler says that ``found`` has ended: this is its job, started again."""
    return bool(found.job) and found.job == me.job and me.restarts > found.restarts


def _name(number: int) -> str:
    return f"owner/{number:06d}"


def _number(name: str) -> int:
    match = re.fullmatch(r"owner/([0-9]{6})", name)
    return int(match[1]) if match else 0
