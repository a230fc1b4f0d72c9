"""Writes new files from the templates beside this module; what is there already stays."""

from __future__ import annotations

import importlib.util
import keyword
import os
import re
import secrets
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from twin.base.errors import UsageError, storage_error

TEMPLATES = Path(__file__).parent / "templates"
ENDING = ".template"
"""End of a template's name that is not written: such files are no modules of ours."""
NAME = re.compile(r"[a-z][a-z0-9]*(?:[_-][a-z0-9]+)*")
NAME_MAX = 40
"""Longest name [characters]."""
NO_TEXTS = ("true", "false", "null")
"""Names that a YAML file takes for something else."""
STACK = "devkit.aeb:AebStack"
"""The stack of a new campaign, unless another is given."""


@dataclass(frozen=True, slots=True)
class NewThing:
    """What was written, and what to do with it."""

    path: Path
    next_steps: tuple[str, ...]
    """Command lines."""
    page: str


def new_campaign(name: str, folder: Path, stack: str = STACK) -> NewThing:
    """Write a campaign file.

    Raises:
        UsageError: the name or the stack cannot be used, the file exists, or cannot be written.
    """
    if not re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", stack):
        raise UsageError(f"--stack {stack}: give MODULE:CLASS, e.g. my_stack:MyStack")
    path = _write_file("campaign.yaml", name, folder, f"{_checked(name)}.yaml", stack=stack)
    shown = shlex.quote(str(path))
    steps = (f"conductor validate {shown}", f"conductor run {shown} --cases 1")
    return NewThing(path, steps, "docs/campaign.md")


def new_stack(name: str, folder: Path) -> NewThing:
    """Write a module with a stack.

    Raises:
        UsageError: as :func:`new_campaign`; or another module has that name.
    """
    module = _module(name)
    path = _write_file("stack.py.template", name, folder, f"{module}.py")
    place = f"{module}:{_class(name)}"
    where = f"PYTHONPATH={shlex.quote(str(folder))} "
    steps = (
        f"{where}devkit check {place}",
        f"conductor new campaign {name}-first --stack {place}",
        f"{where}conductor run {name}-first.yaml --cases 1",
    )
    return NewThing(path, steps, "docs/stack.md")


def new_scenario(name: str, folder: Path) -> NewThing:
    """Write a scenario file.

    Raises:
        UsageError: as :func:`new_campaign`.
    """
    path = _write_file("scenario.yaml", name, folder, f"{_checked(name)}.yaml")
    shown = shlex.quote(str(path))
    steps = (f"twin validate scenario {shown}", f"twin play {shown}")
    return NewThing(path, steps, "docs/scenarios.md")


def new_plugin(name: str, folder: Path) -> NewThing:
    """Write a distribution that brings a perception variant, with a test and a campaign.

    Raises:
        UsageError: as :func:`new_campaign`; or another module has that name.
    """
    module = _module(name)
    target = folder / name
    _refuse_existing(target)
    temporary = folder / f".{name}.{secrets.token_hex(4)}.tmp"
    try:
        for source in sorted(p for p in (TEMPLATES / "plugin").rglob("*") if p.is_file()):
            inside = source.relative_to(TEMPLATES / "plugin").as_posix().removesuffix(ENDING)
            path = temporary / inside.replace("module/", f"{module}/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(_filled(source.read_text(encoding="utf-8"), name), encoding="utf-8")
        temporary.rename(target)
    except OSError as error:
        raise storage_error(error, str(target)) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    shown = shlex.quote(str(target))
    steps = (
        f"pip install --editable {shown}",
        f"pytest {shown}/tests",
        f"conductor validate {shown}/campaign.yaml",
    )
    return NewThing(target, steps, "docs/kinds.md")


def _write_file(template: str, name: str, folder: Path, file: str, *, stack: str = STACK) -> Path:
    path = folder / file
    text = _filled((TEMPLATES / template).read_text(encoding="utf-8"), name, stack)
    _refuse_existing(path)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(descriptor, "w", encoding="utf-8") as writing:
            writing.write(text)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    return path


def _refuse_existing(path: Path) -> None:
    if path.exists() or path.is_symlink():
        raise UsageError(f"{path}: exists already; choose another NAME, or another --into")
    if not path.parent.is_dir():
        raise UsageError(f"--into {path.parent}: no such folder; make it first")


def _filled(text: str, name: str, stack: str = STACK) -> str:
    """A template with the name in it."""
    words = {"NAME": name, "MODULE": name.replace("-", "_"), "CLASS": _class(name), "STACK": stack}
    return re.sub(r"@([A-Z]+)@", lambda found: words[found[1]], text)


def _checked(name: str) -> str:
    if len(name) > NAME_MAX or not NAME.fullmatch(name):
        raise UsageError(
            f"NAME '{name}': allowed are at most {NAME_MAX} lower-case letters and digits, with "
            "single '-' or '_' between them, e.g. rainy-night"
        )
    if name in NO_TEXTS:
        raise UsageError(
            f"NAME '{name}': YAML has a value '{name}', which is no text; choose another"
        )
    return name


def _module(name: str) -> str:
    """Name of the module; nothing else is imported by it."""
    module = _checked(name).replace("-", "_")
    if keyword.iskeyword(module) or importlib.util.find_spec(module) is not None:
        raise UsageError(
            f"NAME '{name}': Python has a word or a module '{module}' already; choose another"
        )
    return module


def _class(name: str) -> str:
    """Name of the class, e.g. ``RainyNight``."""
    return "".join(part.capitalize() for part in re.split("[_-]", name))
