"""Bridges: other protocols for stacks, as stacks of our own that ask somebody else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from devkit.stack import Stack

if TYPE_CHECKING:
    from devkit.foreign import Script


class ScriptBridge(Stack):
    """A stack that hands every instant to a script, which runs beside it."""

    def attach(self, script: Script | None) -> None:
        """The host has started ``script``; None: somebody else has."""
