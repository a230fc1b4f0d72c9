"""A stack in a process of its own: the files that its command line names."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from schemas.sections.foreign import Foreign
from twin.stack_identity.content import Budget, named_path
from twin.stack_identity.imports import Imports, search_path

_SYSTEM = tuple(
    Path(folder) for folder in ("/bin", "/dev", "/lib", "/lib64", "/proc", "/sbin", "/sys", "/usr")
)
"""Programs and files below these are the host's."""


class CommandFiles:
    """The files that the words of a command line name, and what a Python program among them
    imports."""

    def __init__(self, foreign: Foreign, budget: Budget) -> None:
        self._foreign = foreign
        self._folder = _working_folder(foreign.command)
        self._budget = budget
        self.files: dict[str, Path] = {}
        self.distributions: set[str] = set()

    def look(self) -> None:
        """Look at every word."""
        words = self._foreign.command
        for index, word in enumerate(words):
            path = self._path(word, is_program=index == 0)
            name = f"autonomy.command[{index}]"
            interpreter = next(filter(_is_python, words[:index]), "")
            if path is None:
                if interpreter and words[index - 1] == "-m":
                    self._add_module(word, interpreter)
                continue
            if not _is_system(path):
                self.files |= named_path(name, path, self._budget)
            if _is_script(path):
                self._add_imports(path, interpreter or _interpreter(path))

    def _path(self, word: str, *, is_program: bool) -> Path | None:
        """The file that a word, or what stands behind its ``=``, names; None: it names none."""
        for text in (word, word.partition("=")[2]):
            if not text or (text.startswith("-") and text == word and "=" in word):
                continue
            if not text.startswith("/") and self._foreign.repository is not None:
                continue  # its files are known by their commit
            path = self._folder / text
            try:
                if path.is_file() and self._is_seen(path):
                    return path
            except (OSError, ValueError):
                continue
        if not is_program or "/" in word or self._foreign.image or self._foreign.repository:
            return None
        program = shutil.which(word)
        return Path(program) if program else None

    def _is_seen(self, path: Path) -> bool:
        """A container sees the working folder, ``/tmp`` and what is bound."""
        image = self._foreign.image
        if image is None:
            return True
        visible = [Path.cwd(), Path("/tmp"), *(Path(folder) for folder in image.binds)]
        return any(folder in path.absolute().parents for folder in visible)

    def _add_module(self, module: str, interpreter: str) -> None:
        """``python -m module``."""
        here = self._foreign.image is None and _is_ours(interpreter)
        path = search_path(self._folder / "__main__.py", environment=here)
        imports = Imports(path, self._budget)
        imports.add_module(f"{module}.__main__")
        imports.add_module(module)
        self._keep(imports)

    def _add_imports(self, script: Path, interpreter: str) -> None:
        here = self._foreign.image is None and _is_ours(interpreter)
        imports = Imports(search_path(script, environment=here), self._budget)
        imports.add_script(script)
        self._keep(imports)

    def _keep(self, imports: Imports) -> None:
        self.files |= imports.files
        self.distributions |= imports.distributions


def _working_folder(words: Sequence[str]) -> Path:
    """The folder that ``env -C FOLDER`` changes to, or this one."""
    if Path(words[0]).name == "env":
        for word, following in zip(words, [*words[1:], ""], strict=True):
            if word in ("-C", "--chdir"):
                return Path(following).absolute()
            if word.startswith("--chdir="):
                return Path(word.partition("=")[2]).absolute()
    return Path.cwd()


def _is_python(word: str) -> bool:
    return Path(word).name.startswith("python")


def _is_ours(interpreter: str) -> bool:
    """Whether a program named so is the Python of this environment."""
    program = shutil.which(interpreter)
    return program is not None and Path(program).parent == Path(sys.executable).parent


def _is_script(path: Path) -> bool:
    first = _first_line(path)
    return path.suffix == ".py" or (first.startswith("#!") and "python" in first)


def _interpreter(script: Path) -> str:
    """Interpreter that a script's first line names, ``env`` aside."""
    words = _first_line(script).removeprefix("#!").split()
    return words[-1] if words else ""


def _first_line(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.readline(256).decode(errors="replace").strip()
    except OSError:
        return ""


def _is_system(path: Path) -> bool:
    """A program of the host or of this Python environment."""
    parents = path.absolute().parents
    return any(folder in parents for folder in (*_SYSTEM, Path(sys.prefix), Path(sys.base_prefix)))
