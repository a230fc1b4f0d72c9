"""What a result store is: small and large objects by name, and one operation that has a winner."""

from __future__ import annotations

from typing import Protocol

from twin.base.errors import InfrastructureError, UsageError

SMALL_BYTES_MAX = 1 << 26
"""Largest object that is read as a whole where nothing else limits it [bytes]."""


class StoreError(InfrastructureError):
    """The store did not do it, though it was tried several times; later it may."""


class StoreRefusedError(UsageError):
    """The store will never do it: no rights, no such bucket."""


class MissingObjectError(StoreError):
    """There is no object of this name."""


class DamagedObjectError(StoreError):
    """An object is not what its name says."""


class ResultStore(Protocol):
    """Objects by name; names are relative, with ``/`` between their parts.

    Every call may wait, and raises :class:`StoreError` or :class:`StoreRefusedError`. Calls may
    come from several threads.
    """

    url: str
    """How a user names it; holds no secret."""

    def put(self, name: str, data: bytes) -> None:
        """Write an object, complete or not at all; one that is there is replaced."""

    def create(self, name: str, data: bytes) -> bool:
        """Write an object that is not there yet; False: it is there, with another content, which
        may be a part of ours: choose another name.

        Of several who try at once one wins, if the store can do that at all: see
        :func:`twin.stores.opening.has_winners`.
        """

    def get(self, name: str, size_max: int = SMALL_BYTES_MAX) -> bytes:
        """Content of an object.

        Raises:
            MissingObjectError: there is none.
            DamagedObjectError: it is larger than ``size_max`` [bytes].
        """

    def names(self, prefix: str) -> list[str]:
        """Names of objects below ``prefix``, which ends in ``/``, sorted; what was written lately
        may be missing."""

    def delete(self, name: str) -> None:
        """Remove an object; one that is not there is no mistake."""
