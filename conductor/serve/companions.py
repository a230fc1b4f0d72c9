"""Requests that share a transaction: on a slow disk a commit waits for those about to come.

A worker whose cases take no time asks again as soon as it has its reply. Two of them on a slow disk
would take turns, each with a commit of its own, which is half of what the disk can do. So after a
slow commit the next one waits a little for whoever has just been answered. Where nobody comes, it
does so more and more rarely.
"""

from __future__ import annotations

from dataclasses import dataclass

SLOW_COMMIT_S = 0.001
"""Nobody is waited for after a commit that was quicker [s]."""
WAIT_SHARE = 0.9
"""Longest wait after the replies, as a share of the commit before them."""
WAIT_MAX_S = 0.005
"""Longest wait, however long that commit took [s]."""
SKIPPED_MAX = 16
"""Most commits without a wait after waits in vain."""


@dataclass(slots=True)
class Companions:
    """Decides for whom the next commit waits. It has no clock: times come in."""

    expected: int = 0
    """Number of requests that the next transaction should have."""
    until_s: float = 0.0
    """Until when it waits for them, on the caller's clock [s]."""
    _skip: int = 0
    """Commits without a wait that are still to come."""
    _in_vain: int = 0
    """Waits in vain, one after the other."""

    def committed(self, wall_s: float, replies: int, waiting: int, now_s: float) -> None:
        """A commit has ended, and its replies have just left.

        Args:
            wall_s: how long the commit took [s].
            replies: number of requests that were answered.
            waiting: number of requests that have come meanwhile.
            now_s: the time [s].
        """
        self.expected = 0
        if wall_s < SLOW_COMMIT_S or not replies:
            return
        if self._skip:
            self._skip -= 1
            return
        self.expected = waiting + replies
        self.until_s = now_s + min(WAIT_SHARE * wall_s, WAIT_MAX_S)

    def waited(self, came: int) -> None:
        """A wait is over, in which so many requests came; not called if nobody was lacking."""
        if came:
            self._in_vain = 0
            return
        self._in_vain += 1
        self._skip = min(2**self._in_vain, SKIPPED_MAX)
