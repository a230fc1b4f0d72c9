"""Locks on folders, which go with the process that holds them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from twin.base.errors import InfrastructureError


@contextlib.contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Let nobody else write to ``folder`` meanwhile; it is made if it is missing.

    Raises:
        InfrastructureError: somebody does.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(_locked(folder, "LOCK_EX", "LOCK_NB"))
        except BlockingIOError:
            raise InfrastructureError(
                f"{folder}: another process is writing to it; wait for it or give another folder"
            ) from None
        yield


def one_of_the_writers(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Writes beside others, until :func:`after_all_writers` waits for them."""
    return _locked(folder, "LOCK_SH")


def after_all_writers(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Waits until nobody is :func:`one_of_the_writers` any more."""
    return _locked(folder, "LOCK_EX")


@contextlib.contextmanager
def _locked(folder: Path, *how: str) -> Iterator[None]:
    import fcntl  # not everywhere where the fabric is

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, sum(getattr(fcntl, name) for name in how))
        yield
    finally:
        os.close(descriptor)
