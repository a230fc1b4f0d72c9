"""Leases that a worker holds, and the rig that runs them."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.wire.control import Ended, Lease, Release, Touch


@dataclass(slots=True)
class Held:
    """Lease that the worker holds."""

    lease: Lease
    progress: int = -1
    moved_ns: int = 0
    """Time at which progress was last seen [ns]."""
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
