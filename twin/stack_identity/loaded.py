"""Modules that a stack has loaded although no import statement names them."""

from __future__ import annotations

import sys
from pathlib import Path

from twin.base.errors import RefusedError
from twin.stack_identity.identity import StackFiles
from twin.stack_identity.imports import OURS, is_standard
from twin.stack_identity.installed import claimants


class LoadedModules:
    """Watches that this process loads no module of the stack whose content does not count."""

    def __init__(self, found: StackFiles, shown: str) -> None:
        """Watch what is imported from now on; ``shown``: the stack, in messages."""
        self._counted = found.paths
        self._shown = shown
        self._known = set(sys.modules)
        self._count = len(sys.modules)
        self._installed: dict[tuple[Path, str], bool] = {}

    def check(self) -> None:
        """Look at what was loaded since the last call; next to nothing if that is nothing.

        Raises:
            RefusedError: a module is in no file that counts; one line that names it.
        """
        if len(sys.modules) == self._count:
            return
        self._count = len(sys.modules)
        for name, module in sorted(sys.modules.items()):
            if name in self._known:
                continue
            self._known.add(name)
            file = getattr(module, "__file__", None)
            if isinstance(file, str) and not self._counts(name, Path(file)):
                raise RefusedError(
                    f"{self._shown}: it loads {file} otherwise than by an import statement, so a "
                    "change of that file would go unnoticed; name it, or its folder, under "
                    "autonomy.files in the campaign"
                )

    def _counts(self, name: str, file: Path) -> bool:
        if file.resolve() in self._counted or name.partition(".")[0] in OURS:
            return True
        return is_standard(file) or self._is_installed(file)

    def _is_installed(self, file: Path) -> bool:
        """Whether a distribution installed this module's file."""
        for entry in sorted({entry for entry in sys.path if entry}, key=len, reverse=True):
            folder = Path(entry)
            if folder in file.parents:
                top = file.relative_to(folder).parts[0].partition(".")[0]
                if (folder, top) not in self._installed:
                    self._installed[folder, top] = bool(claimants(folder, top))
                return self._installed[folder, top]
        return False
