"""Command lines that run a command inside a container image, for three runtimes. Pure text.

The same paths are seen inside and outside, since the campaign, its journal and its workers on other
nodes name them. The home folder stays outside: packages in it would hide those of the image. The
environment goes in as it is (the scheduler's variables, ``CUDA_VISIBLE_DEVICES``, ``TWIN_*``,
``WARP_CACHE_PATH``), except what would lead Python out of the image.

What was found out about the runtimes:

- Apptainer without root cannot bind a folder to a place that the image does not have unless it may
  overlay it; it does that by itself ("underlay").
- ``ch-run`` cannot: the places of the bound folders are made in the image folder before, see
  :func:`preparation`. A squashfs image is read-only, so such an image must hold them already.
- ``ch-run`` has no option for GPUs: ``ch-fromhost`` copies the driver's libraries into the folder.
- Podman hides the environment: names are given one by one or by prefix. ``--rm`` is the work of its
  monitor, so a container whose monitor was killed stays in the list: it is removed by name.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from typing import Literal

from twin.base.errors import UsageError

Runtime = Literal["apptainer", "charliecloud", "podman"]
"""Container runtimes that need no root."""

RUNTIMES: tuple[Runtime, ...] = ("apptainer", "charliecloud", "podman")

BIN_FOLDER = "/opt/drivetwin/bin"
"""Folder of the commands in an image made by ``hpc image build``."""

COMMANDS: dict[Runtime, str] = {
    "apptainer": "apptainer",
    "charliecloud": "ch-run",
    "podman": "podman",
}
"""The command that runs something in an image."""

MOUNT_POINTS = (
    *("/data", "/gpfs", "/lustre", "/mnt", "/nfs", "/project", "/projects"),
    *("/scratch", "/shared", "/users", "/work"),
)
"""Empty folders in our images, where clusters mount their file systems."""

UNSET = ("PYTHONPATH", "PYTHONHOME", "LD_PRELOAD")
"""Variables of the login shell that would lead Python out of the image."""

PASSED = (
    *("CUDA_VISIBLE_DEVICES", "CUDA_DEVICE_ORDER", "WARP_CACHE_PATH", "TMPDIR", "TZ"),
    *("SLURM*", "PBS_*", "TWIN_*", "ZENOH_*", "DRIVETWIN_HOME"),
)
"""Variables that the fabric and the job script need inside; ``*`` ends a prefix."""

_WITH_VALUE = ("--bind", "--pwd", "--env")


@dataclass(frozen=True, slots=True, kw_only=True)
class Container:
    """An image and how it is entered.

    Raises:
        UsageError: a value cannot be used; one line says what is allowed.
    """

    image: str
    """Absolute path of a SIF, squashfs or folder; with podman also a name like ``org/name:1``."""
    runtime: Runtime = "apptainer"
    binds: tuple[str, ...] = ()
    """Absolute paths that are seen inside as outside: run folder, campaign folder, scratch."""
    folder: str = "/"
    """Working folder inside; absolute, and below one of ``binds``."""
    gpus: bool = False
    """Let the host's NVIDIA driver in."""
    name: str = ""
    """Podman's name of it, by which what is left of it is removed; empty: it chooses one."""

    def __post_init__(self) -> None:
        if self.runtime not in RUNTIMES:
            raise UsageError(
                f"--container-runtime {self.runtime!r}: allowed are {', '.join(RUNTIMES)}"
            )
        if not self.image or self.image.startswith("-"):
            raise UsageError(f"--container {self.image!r}: give the path of an image")
        if self.name and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", self.name):
            raise UsageError(f"--name {self.name!r}: allowed are letters, digits and _ . -")
        if self.runtime != "podman" and not self.image.startswith("/"):
            raise UsageError(
                f"--container {self.image!r}: give an absolute path that all nodes see; "
                "`hpc image build` makes an image"
            )
        for path in (*self.binds, self.folder):
            if not path.startswith("/"):
                raise UsageError(f"container folder {path!r}: give an absolute path")
            if any(char in path for char in ":,\n"):
                raise UsageError(
                    f"container folder {path!r}: no ':' ',' or line break, the runtimes cut there"
                )


def prefix(container: Container) -> list[str]:
    """The words before a command that make it run inside."""
    words = {"apptainer": _apptainer, "charliecloud": _charliecloud, "podman": _podman}
    return [COMMANDS[container.runtime], *words[container.runtime](container)]


def preparation(container: Container) -> list[list[str]]:
    """Commands that must have run before the first use: bound folders exist, outside and inside."""
    commands = [["mkdir", "-p", "--", *mounted(container)]] if container.binds else []
    if container.runtime != "charliecloud" or container.image.endswith((".sqfs", ".squashfs")):
        return commands
    commands.append(["mkdir", "-p", "--", *(container.image + path for path in mounted(container))])
    if container.gpus:
        commands.append(["ch-fromhost", "--nvidia", container.image])
    return commands


def removal(runtime: Runtime, name: str) -> list[list[str]]:
    """Commands that remove what a runtime keeps of a container whose processes were killed."""
    if runtime != "podman":
        return []
    return [["podman", "rm", "--force", "--ignore", "--time=0", name]]


def mounted(container: Container) -> tuple[str, ...]:
    """Bound folders without those that lie in another one, in the order given."""
    folders = tuple(dict.fromkeys(path.rstrip("/") or "/" for path in container.binds))
    return tuple(
        path
        for path in folders
        if not any(path != other and path.startswith(other.rstrip("/") + "/") for other in folders)
    )


def shell_lines(container: Container) -> list[str]:
    """Lines for a job script: they prepare the image and put :func:`prefix` into the array
    ``inside``.

    ``"${inside[@]}" COMMAND`` then runs it in the container.
    """
    lines = [f"{shlex.join(words)} || exit 2" for words in preparation(container)]
    if container.runtime == "charliecloud":
        lines.append('export USER="${USER:-$(id -un)}"  # it does not start without')
    return [*lines, "inside=(", *_wrapped(prefix(container)), ")"]


def _wrapped(words: list[str]) -> list[str]:
    """An option per line, with its value, so that the script stays readable."""
    lines: list[str] = []
    for word in words:
        if lines and lines[-1].strip() in _WITH_VALUE:
            lines[-1] += f" {shlex.quote(word)}"
        else:
            lines.append(f"  {shlex.quote(word)}")
    return lines


def _apptainer(container: Container) -> list[str]:
    words = ["exec", "--no-home"]
    if container.gpus:
        words.append("--nv")
    for path in mounted(container):
        words += ["--bind", path]
    words += ["--pwd", container.folder]
    # Empty counts as not set, for each of them; Apptainer has no option that unsets.
    for name in UNSET:
        words += ["--env", f"{name}="]
    return [*words, container.image]


def _charliecloud(container: Container) -> list[str]:
    words = []
    for path in mounted(container):
        words.append(f"--bind={path}")
    words.append(f"--cd={container.folder}")
    words += [f"--unset-env={name}" for name in UNSET]
    # The image's own commands must be found first; the rest of the environment is the host's.
    words.append(f"--set-env=PATH={BIN_FOLDER}:/usr/local/bin:/usr/bin:/bin")
    return [*words, container.image, "--"]


def _podman(container: Container) -> list[str]:
    # One user, one network: the worker reaches the conductor, files belong to who started the job.
    words = ["run", "--rm", "--init", "--network=host", "--ipc=host", "--userns=keep-id"]
    if container.name:  # one that was killed stays in the list, and its name with it
        words += [f"--name={container.name}", "--replace"]
    words.append("--security-opt=label=disable")
    if container.gpus:
        words.append("--device=nvidia.com/gpu=all")
    for path in mounted(container):
        words.append(f"--volume={path}:{path}")
    words.append(f"--workdir={container.folder}")
    words += [f"--env={name}" for name in PASSED]
    return [*words, container.image]
