"""Bridges: other protocols for stacks, as stacks of our own that ask somebody else."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

from devkit.stack import ParameterValue, Stack, fields_of
from schemas.kinds.bridge import bridges
from schemas.kinds.registry import implementation
from schemas.validation import convert_all

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


def parameter_mistakes(name: str, parameters: Mapping[str, ParameterValue]) -> dict[str, str]:
    """Parameter -> one line that says why a bridge does not take its value; it is not started.

    A bridge says what it takes by :attr:`devkit.stack.Stack.PARAMETERS`; of others nothing is
    known. Names that it does not know are found in its source, like those of stacks.

    Raises:
        ValueError: there is no such bridge, or it cannot be imported; one line.
    """
    parts = getattr(implementation(bridges().find(name).implementation), "PARAMETERS", ())
    found = {}
    for part in parts:
        values = {key: parameters[key] for key in fields_of(part) if key in parameters}
        found.update((mistake.path, mistake.message) for mistake in convert_all(values, part)[1])
    return found
