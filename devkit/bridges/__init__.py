"""Bridges: other protocols for stacks, as stacks of our own that ask somebody else."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from devkit.stack import Stack

if TYPE_CHECKING:
    from devkit.hosting.foreign import ForeignProcess


class ScriptBridge(Stack):
    """A stack that hands every instant to a script, which runs beside it."""

    @abstractmethod
    def attach(self, script: ForeignProcess | None) -> None:
        """Start ``script``; None: somebody else has started one. Called once, before all else.

        Raises:
            TwinError: it cannot be started, or not now.
        """
