"""Which batch system is meant: one that is named, or the one whose commands are here."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from hpc.commands import exists
from schemas.kinds.batch_system import AUTO, BatchSystemKind, batch_systems
from schemas.kinds.registry import implementation
from schemas.words import none_of
from twin.base.errors import InfrastructureError, UsageError

if TYPE_CHECKING:
    from hpc.scheduler import Scheduler


def backend(name: str) -> Scheduler:
    """The batch system called ``name``; ``auto``: the first of all, for scripts that are printed.

    Raises:
        UsageError: there is none, or its distribution is broken.
    """
    declared = batch_systems().declared[0] if name == AUTO else _declared(name)
    try:
        return cast("Scheduler", implementation(declared.implementation)())
    except ValueError as error:
        raise UsageError(f"scheduler {declared.name}: {error}") from None


def present() -> BatchSystemKind | None:
    """The first batch system whose commands are on this host, or None."""
    kinds = batch_systems().declared
    return next((kind for kind in kinds if kind.submits and exists(kind.submits)), None)


def programs() -> list[str]:
    """The commands by which batch systems are found."""
    return [kind.submits for kind in batch_systems().declared if kind.submits]


def scheduler(name: str) -> Scheduler:
    """The batch system called ``name``; ``auto`` looks which commands are there.

    Raises:
        UsageError: there is none of that name.
        InfrastructureError: its commands are not there.
    """
    if name == AUTO:
        system, submits = present(), programs()
    else:
        declared = _declared(name)
        here = not declared.submits or exists(declared.submits)
        system, submits = declared if here else None, [declared.submits]
    if system is None:
        raise InfrastructureError(
            f"{none_of(submits)} on this host, so nothing can be submitted from here; log in to a "
            "login node of the cluster, or write the script with `hpc render` and submit it there"
        )
    return backend(system.name)


def _declared(name: str) -> BatchSystemKind:
    try:
        return batch_systems().find(name)
    except ValueError as error:
        raise UsageError(f"scheduler {name}: {error}") from None
