"""Whether a scenario that was written can be played."""

from __future__ import annotations

from pathlib import Path

from twin.base.errors import UsageError
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native


def check_scenario(path: Path) -> None:
    """Compile a scenario file.

    Raises:
        UsageError: it cannot be played; a line for each mistake.
    """
    try:
        compile_native(load_native(path))
    except ValueError as error:
        raise UsageError(str(error)) from None
