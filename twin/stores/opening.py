"""Opening of a result store by its URL, and what has to be known of it first."""

from __future__ import annotations

import secrets

from schemas.escape import escape
from schemas.kinds.registry import implementation
from schemas.kinds.result_store import ResultStoreKind, result_stores
from twin.base.errors import UsageError
from twin.stores.protocol import ResultStore, StoreError

PROBE = "probe"
"""Prefix of objects that are made to see what a store can do."""
_PROBES = 5
"""How often that is tried where objects are written in part."""


def is_url(text: str) -> bool:
    """Whether ``text`` names a store by a URL, and no path."""
    return "://" in text


def checked_url(url: str) -> str:
    """``url`` if it may be said in logs, messages and process lists.

    Raises:
        UsageError: it holds credentials or options, or its scheme is unknown.
    """
    scheme, separator, place = url.partition("://")
    if separator and ":" in place.rpartition("@")[0]:  # a secret may hold a slash
        raise UsageError(
            f"--store {scheme}://...: credentials in a URL are seen by everybody who sees process "
            "lists and logs; give them in the environment, or in fsspec's configuration"
        )
    if separator and ("?" in place or "#" in place):
        raise UsageError(
            f"--store {scheme}://...: options in a URL are not read; give them in the environment, "
            "or in fsspec's configuration"
        )
    kind_of(url)
    if separator and not place.strip("/"):
        raise UsageError(f"--store {escape(url, 200)}: names no bucket; {_examples()}")
    return url.rstrip("/") or "/"


def kind_of(url: str) -> ResultStoreKind:
    """The kind of store that ``url`` names.

    Raises:
        UsageError: there is none.
    """
    scheme, separator, _ = url.partition("://")
    scheme = scheme if separator else ""
    for kind in result_stores().declared:
        if scheme in kind.schemes:
            return kind
    schemes = [name for kind in result_stores().declared for name in kind.schemes]
    known = ", ".join(f"{name}://" if name else "a path" for name in schemes)
    raise UsageError(
        f"--store {escape(url, 200)}: no store of this scheme; there: {known}; {_examples()}"
    )


def open_store(url: str) -> ResultStore:
    """The store that ``url`` names.

    Raises:
        TwinError: there is none, a package is missing, or it cannot be made; one line.
    """
    url = checked_url(url)
    try:
        opened: ResultStore = implementation(kind_of(url).implementation)(url)
    except ValueError as error:
        raise UsageError(f"--store {escape(url, 200)}: {error}") from None
    return opened


def has_winners(store: ResultStore) -> bool:
    """Whether of two who create an object one loses, as a takeover needs.

    Raises:
        TwinError: the store does not answer, or lets nobody write.
    """
    for _ in range(_PROBES):
        name = f"{PROBE}/{secrets.token_hex(8)}"
        first = store.create(name, b"first")
        second = store.create(name, b"second")
        store.delete(name)
        if first or second:
            return first and not second
        # Nobody else knows the name: it was written in part, which says nothing of the store.
    raise StoreError(f"{store.url}: what is created there is not what was written; try again")


def _examples() -> str:
    return "e.g. " + " or ".join(kind.example for kind in result_stores().declared)
