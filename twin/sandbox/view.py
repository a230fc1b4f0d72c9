"""What a process in a sandbox sees of the machine, as the words of a ``bwrap`` command. Pure but
for looking which of the system's folders are there.

Everything that is not listed here does not exist inside: no home folder, no ``/run``, no ``/tmp``
of others, no process of the host. What is listed is read-only, except two empty file systems in
memory with a limit each: ``/tmp``, and the working folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

SCRATCH = Path("/tmp")
"""Where a stack may write; also its home folder."""

SCRATCH_BYTES_MAX = 256 << 20
"""What fits in it, and as much again in the working folder [bytes]."""

SHARED_MEMORY_BYTES_MAX = 64 << 20
"""What fits in ``/dev/shm`` [bytes]."""

SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
"""Folders of the system that are seen whole, as far as they exist."""

SYSTEM_FILES = (
    *("/etc/ld.so.cache", "/etc/alternatives", "/etc/fonts", "/etc/localtime"),
    *("/sys/devices/system/cpu", "/sys/devices/system/node"),
)
"""Further files and folders of the system."""

RUNTIME_FILES = ("/etc/apptainer", "/etc/singularity", "/etc/charliecloud")
"""Settings of container runtimes."""

MADE_UP = Path(__file__).parent / "etc"
"""Files of ``/etc`` that say nothing of the host."""

GPU_FILES = ("/sys/bus/pci", "/sys/devices", "/sys/module/nvidia", "/proc/driver/nvidia")
"""What NVIDIA's libraries read beside their devices."""

GPU_DEVICES = Path("/dev")
"""Folder of the devices ``nvidia*``."""

KINDS = {"processes": "pid", "network": "net", "ipc": "ipc"}
"""What can be shared with the host -> bubblewrap's word for a namespace of its own."""

PASSED = (
    *("PATH", "LANG", "LANGUAGE", "TZ", "TERM", "LD_LIBRARY_PATH", "VIRTUAL_ENV"),
    *("PYTHONPATH", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE", "PYTHONHASHSEED"),
    *("PYTHONMALLOC", "PYTHONOPTIMIZE", "PYTHONUTF8", "PYTHONWARNINGS"),
)
"""Environment variables that come in."""

PASSED_PREFIXES = (
    *("LC_", "OMP_", "OPENBLAS_", "GOTO_", "MKL_", "KMP_", "BLIS_", "NUMEXPR_", "OPENCV_"),
    *("VECLIB_", "NVPL_", "ORT_", "CUDA_", "NVIDIA_", "CUBLAS_", "CUDNN_", "WARP_"),
)
"""Beginnings of others: language, threads and kernels of numerical libraries, GPUs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SandboxView:
    """What is seen, and what is shared with the host."""

    readable: Sequence[Path] = ()
    """Absolute files and folders, seen read-only where they are; those that are missing are not."""
    hidden: Sequence[Path] = ()
    """Absolute folders in them that stay unseen: those of runs and keys."""
    writable: Sequence[Path] = ()
    """Absolute folders of the host that it may write to: a service's sockets."""
    empty: Sequence[Path] = ()
    """Absolute folders that are there, with nothing in them but what is readable."""
    folder: Path
    """Working folder; empty but for what is readable in it. One of the system is not taken."""
    device: str = "cpu"
    """Where it computes: ``cpu`` or ``cuda:N``."""
    shared: Sequence[str] = ()
    """What it has in common with the host, of :data:`KINDS`; other words are for people."""
    containers: bool = False
    """It may start a container, which needs namespaces of its own."""
    variables: Mapping[str, str] = field(default_factory=dict)
    """Environment variables beside those of :func:`environment`."""

    @property
    def on_gpu(self) -> bool:
        """Whether the stack computes on a GPU."""
        return self.device.startswith("cuda")


def encode(view: SandboxView) -> str:
    """As JSON, for a process that enters the sandbox later."""
    content = {each.name: getattr(view, each.name) for each in fields(view)}
    return json.dumps({**content, "variables": dict(view.variables)}, default=str)


def decode(text: str) -> SandboxView:
    """What :func:`encode` wrote; nobody but a worker gives it."""
    given: dict[str, Any] = json.loads(text)
    for name in ("readable", "writable", "hidden", "empty"):
        given[name] = [Path(each) for each in given[name]]
    return SandboxView(**{**given, "folder": Path(given["folder"])})


def arguments(view: SandboxView) -> list[str]:
    """The words between ``bwrap`` and the command, but for the filter of system calls."""
    own = [kind for name, kind in KINDS.items() if name not in view.shared]
    words = [f"--unshare-{kind}" for kind in ("user", "uts", *own)] + ["--unshare-cgroup-try"]
    words += ["--die-with-parent", "--new-session", "--cap-drop", "ALL"]
    words += ["--uid", "1000", "--gid", "1000", "--hostname", "stack"]
    for system in map(Path, SYSTEM):
        if system.is_symlink():
            words += ["--symlink", str(system.readlink()), str(system)]
        elif system.is_dir():
            words += ["--ro-bind", str(system), str(system)]
    for name in sorted(path.name for path in MADE_UP.iterdir()):
        words += ["--ro-bind", str(MADE_UP / name), f"/etc/{name}"]
    for file in SYSTEM_FILES:
        words += ["--ro-bind-try", file, file]
    words += ["--proc", "/proc", "--dev", "/dev"]
    if "ipc" in view.shared:
        words += ["--bind", "/dev/shm", "/dev/shm"]
    else:
        words += ["--size", str(SHARED_MEMORY_BYTES_MAX), "--perms", "1777", "--tmpfs", "/dev/shm"]
    if view.on_gpu:
        words += _gpu()
    if view.containers:
        words += ["--dev-bind-try", "/dev/fuse", "/dev/fuse"]
        for file in RUNTIME_FILES:
            words += ["--ro-bind-try", file, file]
    folder = working_folder(view)
    scratch = list(dict.fromkeys([SCRATCH, folder]))
    # A folder comes before what lies in it.
    found = [path for path in dict.fromkeys(view.readable) if path != folder or path != SCRATCH]
    for path in sorted({*scratch, *found}, key=lambda each: len(each.parts)):
        if path in found:
            words += ["--ro-bind-try", str(path), str(path)]
        else:
            words += ["--size", str(SCRATCH_BYTES_MAX), "--perms", "0700", "--tmpfs", str(path)]
    for path in view.empty:
        words += ["--dir", str(path)]
    for path in view.writable:
        words += ["--bind-try", str(path), str(path)]
    for path in view.hidden:
        if any(path == each or each in path.parents for each in found):
            words += ["--tmpfs", str(path), "--remount-ro", str(path)]
    return [*words, "--remount-ro", "/dev", "--remount-ro", "/", "--chdir", str(folder)]


def working_folder(view: SandboxView) -> Path:
    """The working folder of ``view``, or the scratch where that would hide the system or files that
    are to be read."""
    fixed = [Path(each) for each in (*SYSTEM, "/proc", "/dev", "/sys", "/etc")]
    covered = (*fixed, *(each for each in view.readable if each != view.folder))
    if view.folder == Path("/") or any(
        view.folder == each or each in view.folder.parents for each in covered
    ):
        return SCRATCH
    return view.folder


def _gpu() -> list[str]:
    words = []
    for device in sorted(GPU_DEVICES.glob("nvidia*")):
        words += ["--dev-bind", str(device), str(device)]
    for file in GPU_FILES:
        words += ["--ro-bind-try", file, file]
    return words


def environment(view: SandboxView, given: Mapping[str, str]) -> dict[str, str]:
    """The variables inside; what else is ``given`` stays outside, such as tokens of a cloud."""
    passed = {
        name: value
        for name, value in given.items()
        if name in PASSED or name.startswith(PASSED_PREFIXES)
    }
    own = {"HOME": str(SCRATCH), "TMPDIR": str(SCRATCH), "USER": "stack", "LOGNAME": "stack"}
    return {**passed, **own, **view.variables, "PWD": os.fspath(working_folder(view))}
