"""What a stack's process is kept from on this machine, and what the record says of it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from schemas.case import Case
from schemas.sections.autonomy import SANDBOX, UNPROTECTED, open_by_nature
from schemas.sections.foreign import ContainerImage
from twin.base.gpu.compiled_kernels import VARIABLE, compiled_folder
from twin.base.gpu.first_use import PIPES_VARIABLE, PLACE_VARIABLE, TURNS_VARIABLE
from twin.sandbox.possible import why_not
from twin.sandbox.reads import python_reads, script_folder, stack_reads
from twin.sandbox.view import SandboxView


@dataclass(frozen=True, slots=True)
class Protection:
    """The sandbox that a stack is started in."""

    said: str
    """``default``, ``strict``, what is shared behind it, or ``unprotected`` and why."""
    view: SandboxView | None
    """The files that the stack sees; None: it runs without a sandbox."""
    later: bool = False
    """Whether its files have to be fetched first, outside."""


def protection(
    case: Case | None, device: str, folder: Path | None, hidden: Sequence[Path] = ()
) -> Protection:
    """The protection of a stack on this host.

    Args:
        case: the first of its rig; None: not known yet, then it is one of ours with nothing beside.
        device: where its rig computes, ``cpu`` or ``cuda:N``.
        folder: of its rig, with the sockets by which it meets its simulator.
        hidden: folders that it does not see even if they lie in what it reads.
    """
    mode = case.rig.sandbox if case is not None else "default"
    if case is not None and (reason := open_by_nature(case.rig)):
        return Protection(f"{UNPROTECTED}: {reason}", None)
    foreign = case.rig.foreign if case is not None else None
    image = foreign.image if foreign is not None else None
    if image is not None and is_podmans(image):
        return Protection(f"{UNPROTECTED}: podman's containers do not start in one", None)
    if reason := why_not():
        return Protection(f"{UNPROTECTED}: {reason}", None)
    reads = python_reads()
    if case is not None:
        reads += stack_reads(
            case.rig.stack,
            case.rig.foreign,
            case.rig.source.files,
            case.rig.parameters,
            case.rig.models,
        )
    if image is not None:
        reads += [Path(image.path), *map(Path, image.binds)]
    on_gpu = device.startswith("cuda")
    shared = ["processes", "ipc"] if on_gpu and mode == "default" else []
    # Charliecloud makes the places of bound folders in the image, which it then shows read-only.
    writable = [Path(image.path)] if image is not None and Path(image.path).is_dir() else []
    if on_gpu and mode == "default" and (pipes := os.environ.get(PIPES_VARIABLE)):
        writable.append(Path(pipes))
        shared.append("Multi-Process Service")
    variables = _turns() if on_gpu else {}
    reads += [Path(path).parent for name, path in variables.items() if name == TURNS_VARIABLE]
    compiled = compiled_folder(device) if on_gpu else None
    if compiled is not None and compiled.is_dir():
        reads.append(compiled)
        variables[VARIABLE] = str(compiled)
    if folder is None:
        shared.append("network")
    else:
        reads.append(folder)
    view = SandboxView(
        readable=reads,
        writable=writable,
        hidden=hidden,
        folder=(foreign and script_folder(foreign)) or Path.cwd(),
        device=device,
        shared=shared,
        containers=image is not None,
        variables=variables,
    )
    later = foreign is not None and foreign.repository is not None
    shown = [*(["GPU"] if on_gpu else []), *shared]
    return Protection(f"{mode}, shares {', '.join(shown)}" if shown else mode, view, later)


def _turns() -> dict[str, str]:
    """The variables by which a process on a GPU waits for its turn to begin, if there are turns."""
    if TURNS_VARIABLE not in os.environ:
        return {}
    names = (TURNS_VARIABLE, PLACE_VARIABLE)
    return {name: os.environ[name] for name in names if name in os.environ}


def is_podmans(image: ContainerImage) -> bool:
    """Whether podman runs the containers of ``image``."""
    others = any(shutil.which(command) for command in ("apptainer", "ch-run"))
    return image.runtime == "podman" or (image.runtime == "auto" and not others)


def lacking_sandbox() -> dict[str, str]:
    """:attr:`schemas.wire.control.Hello.lacks`, as far as sandboxes go."""
    return {SANDBOX: reason} if (reason := why_not()) else {}
