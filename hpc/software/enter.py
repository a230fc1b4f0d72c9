"""The command ``hpc enter``: run a command inside a container image, as the same process."""

from __future__ import annotations

import contextlib
import getpass
import os
import shutil
from pathlib import Path
from typing import Annotated

import typer

from hpc.software.container import (
    COMMANDS,
    RUNTIMES,
    Container,
    Runtime,
    prefix,
    preparation,
    removal,
)
from twin.base.errors import InfrastructureError, UsageError


def enter(
    command: Annotated[list[str], typer.Argument(help="Command line, after `--`.")],
    container: Annotated[str, typer.Option(help="Image: an absolute path, or podman's name.")],
    runtime: Annotated[
        str, typer.Option(help=f"{', '.join(RUNTIMES)}, or auto: the first that is installed.")
    ] = "auto",
    bind: Annotated[
        list[str] | None, typer.Option(help="Absolute folder that is seen inside as outside.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option(help="Working folder, bound as well; default: this one.")
    ] = None,
    gpus: Annotated[bool, typer.Option("--gpus", help="Let the NVIDIA driver in.")] = False,
    name: Annotated[str, typer.Option(help="Podman's name of it, for `hpc leave`.")] = "",
) -> None:
    """Run a command inside a container image; its exit code is the command's."""
    from hpc.commands import become, call

    inside = str((folder or Path()).absolute())
    sandbox = Container(
        image=container,
        runtime=found_runtime(runtime),
        binds=(*(bind or []), inside),
        folder=inside,
        gpus=gpus,
        name=name,
    )
    with contextlib.suppress(KeyError):  # not every number has a name
        os.environ.setdefault("USER", getpass.getuser())  # charliecloud does not start without
    # ch-run shows it as /tmp, and what is bound may lie below the real one.
    os.environ.pop("TMPDIR", None)
    for words in preparation(sandbox):
        done = call(*words)
        if done.code:
            raise InfrastructureError(f"container {container}: {words[0]}: {done.last_words}")
    become(*prefix(sandbox), *command)


def leave(
    name: Annotated[str, typer.Argument(help="As given to `hpc enter --name`.")],
    runtime: Annotated[
        str, typer.Option(help=f"{', '.join(RUNTIMES)}, or auto: the first that is installed.")
    ] = "auto",
) -> None:
    """Remove what a runtime keeps of a container whose processes were killed; podman does."""
    from hpc.commands import call

    for words in removal(found_runtime(runtime), name):
        done = call(*words)
        if done.code:
            raise InfrastructureError(f"container {name}: {words[0]}: {done.last_words}")


def found_runtime(given: str) -> Runtime:
    """The runtime that is meant, which must be installed.

    Raises:
        UsageError: no such runtime, or none is installed.
    """
    if given != "auto":
        for runtime in RUNTIMES:
            if runtime == given:
                return runtime
        raise UsageError(f"--runtime {given!r}: allowed are auto, {', '.join(RUNTIMES)}")
    for runtime in RUNTIMES:
        if shutil.which(COMMANDS[runtime]):
            return runtime
    raise UsageError(
        f"no container runtime on this machine: none of {', '.join(COMMANDS.values())}; load its "
        "module or install one"
    )
