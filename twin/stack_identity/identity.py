"""The identity of a stack: its files together, at submission and where it is loaded."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.digest import digest
from schemas.sections.foreign import ContainerImage, Foreign
from schemas.sections.stack_identity import IMAGE, StackIdentity, StackSource, difference
from twin.base.errors import RefusedError, UsageError
from twin.stack_identity.command import CommandFiles
from twin.stack_identity.content import (
    Budget,
    content_digest,
    named_path,
    tree_digest,
)
from twin.stack_identity.imports import Imports, search_path
from twin.stack_identity.installed import contents

PARTS_MAX = 40
"""Most parts that an identity tells apart: it travels with every case."""

PART_CHARS = 12
"""Hexadecimal digits that are kept of a part's SHA-256."""

PODMAN_S = 20.0
"""Longest wait for podman to name an image [s]."""


@dataclass(frozen=True, slots=True)
class Named:
    """What a campaign says of its stack."""

    stack: str
    """Entry point ``module:Class``; empty: a command alone."""
    foreign: Foreign | None = None
    files: Sequence[str] = ()
    """Absolute paths of further files and folders."""


@dataclass(frozen=True, slots=True)
class StackFiles:
    """A stack's files as they are here."""

    identity: StackIdentity
    paths: frozenset[Path]
    """Every file that counts, links resolved."""


def find_stack(named: Named, *, image: bool = True) -> StackFiles:
    """Locate and read the files of a stack; nothing of it is run.

    Args:
        named: what the campaign says.
        image: the container image counts, too.

    Raises:
        UsageError: a file is missing or cannot be read, or there are too many; one line.
    """
    files, distributions = _located(named)
    known: dict[str, str] = {}
    if named.foreign is not None:
        if image and named.foreign.image is not None:
            known.update(_image(named.foreign.image))
        if named.foreign.repository is not None:
            repository = named.foreign.repository
            pinned = [repository.ref.encode(), repository.setup.encode()]
            known["autonomy.repository"] = digest(pinned)
    known |= {name: content_digest(path) for name, path in files.items()}
    known |= {f"installed/{name}": sha for name, sha in contents(distributions).items()}
    return StackFiles(identity_of(known), frozenset(path.resolve() for path in files.values()))


def stack_files(named: Named) -> list[tuple[str, Path]]:
    """The files of a stack that are not installed, by name; located, not read.

    Raises:
        UsageError: as :func:`find_stack`.
    """
    return sorted(_located(named)[0].items())


def _located(named: Named) -> tuple[dict[str, Path], set[str]]:
    """Files of a stack by name, and the distributions that it imports."""
    budget = Budget()
    files: dict[str, Path] = {}
    distributions: set[str] = set()
    if named.stack:
        imports = Imports(search_path(), budget)
        module = named.stack.partition(":")[0]
        if not imports.add_module(module):
            raise UsageError(f"no module '{module}'; install it or put its folder on PYTHONPATH")
        files |= imports.files
        distributions |= imports.distributions
    if named.foreign is not None:
        command = CommandFiles(named.foreign, budget)
        command.look()
        files |= command.files
        distributions |= command.distributions
    for index, name in enumerate(named.files):
        files |= named_path(f"autonomy.files[{index}]", Path(name), budget)
    return files, distributions


def named_files(values: Iterable[Any]) -> dict[str, str]:
    """SHA-256 of those of a stack's parameters that are the path of a file, or with a ``/`` in it
    of a folder.

    Raises:
        UsageError: one cannot be read, or there are too many files.
    """
    budget = Budget()
    known = {}
    for value in values:
        if isinstance(value, str) and (files := _parameter(value, budget)):
            contents = {name: content_digest(path) for name, path in files.items()}
            known[value] = contents.get(value) or _digest(contents)
    return known


def confirm(named: Named, source: StackSource, parameters: Mapping[str, Any]) -> StackFiles | None:
    """Compare the stack here with the one of the submission; None: nothing is known of that.

    Args:
        named: what the campaign says.
        source: what the stack consisted of then.
        parameters: its own; some may name files.

    Raises:
        RefusedError: it is another one, in one line.
    """
    submitted, shown = source.identity, shown_name(named)
    _confirm_parameters(shown, source.parameters, parameters)
    if not submitted.digest:
        return None
    try:
        present = find_stack(named, image=IMAGE in submitted.parts)
    except UsageError as error:
        raise RefusedError(f"{shown}: {error}") from None
    what = difference(submitted, present.identity)
    if what:
        raise RefusedError(
            f"{shown}: {what} since the campaign was submitted (stack digest "
            f"{submitted.digest[:12]}, here {present.identity.digest[:12]}); put it back, or run "
            "the campaign anew with another --out"
        )
    return present


def _confirm_parameters(
    shown: str, submitted: Mapping[str, str], parameters: Mapping[str, Any]
) -> None:
    try:
        here = named_files(parameters[key] for key in submitted)
    except UsageError as error:
        raise RefusedError(f"{shown}: {error}") from None
    for key, sha in submitted.items():
        now = here.get(parameters[key])
        if now != sha:
            what = "has changed" if now else "is missing"
            raise RefusedError(
                f"{shown}: autonomy.parameters.{key} ({parameters[key]}) {what} since the campaign "
                "was submitted; put it back, or run the campaign anew with another --out"
            )


def shown_name(named: Named) -> str:
    """The stack in a few words."""
    if named.foreign is not None:
        return f"stack command {shlex.join(named.foreign.command)[:120]!r}"
    return f"stack {named.stack}"


def identity_of(known: Mapping[str, str]) -> StackIdentity:
    """The identity of a stack.

    Args:
        known: name -> SHA-256. Names are paths relative to where modules are found, or begin with
            the campaign's key or with ``installed``.
    """
    if not known:
        return StackIdentity()
    return StackIdentity(_digest(known), _parts(known))


def _digest(known: Mapping[str, str]) -> str:
    return digest(f"{name}={known[name]}".encode() for name in sorted(known))


def _parts(known: Mapping[str, str]) -> dict[str, str]:
    """Files, or so deep folders that there are few enough; distributions are put together first."""
    deepest = max(name.count("/") for name in known) + 1
    for depth in range(deepest, 0, -1):
        groups: dict[str, dict[str, str]] = {}
        for name, sha in known.items():
            installed = name.startswith("installed/") and len(known) > PARTS_MAX
            folder = "/".join(name.split("/")[: 1 if installed else depth])
            groups.setdefault(folder, {})[name] = sha
        if len(groups) <= PARTS_MAX:
            return {name: _part(name, groups[name]) for name in sorted(groups)}
    rest = {name: sha for name, sha in known.items() if name != IMAGE}
    image = {IMAGE: known[IMAGE][:PART_CHARS]} if IMAGE in known else {}
    return {"one of its files": _digest(rest)[:PART_CHARS], **image}


def _part(name: str, group: Mapping[str, str]) -> str:
    return (group[name] if list(group) == [name] else _digest(group))[:PART_CHARS]


def _parameter(value: str, budget: Budget) -> dict[str, Path]:
    """Files of a parameter that is the path of a file, or with a ``/`` in it of a folder."""
    try:
        path = Path(value)
        is_path = bool(value) and (path.is_file() or ("/" in value and path.is_dir()))
    except (OSError, ValueError):
        return {}  # no path at all
    return named_path(value, path, budget) if is_path else {}


def _image(image: ContainerImage) -> dict[str, str]:
    """The content of a container image, or podman's id of it; nothing: it cannot be had here."""
    path = Path(image.path)
    if path.is_file():
        return {IMAGE: content_digest(path)}
    if path.is_dir():
        return {IMAGE: tree_digest(path)}
    podman = shutil.which("podman")
    if podman is None or image.runtime not in ("auto", "podman"):
        return {}
    words = [podman, "image", "inspect", "--format", "{{.Id}}", "--", image.path]
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PODMAN_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return {}
    image_id = done.stdout.strip().removeprefix("sha256:")
    return {IMAGE: image_id} if done.returncode == 0 and image_id else {}
