"""A stack that drives as the shipped one does, and tries on the way to reach what is none of its
business. What came of each attempt stands in its output as ``CHEAT name: what was seen``; whatever
begins with ``REACHED`` is a hole.

``targets`` says where things are, as JSON: a parameter that were a path would be shown to it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from devkit.aeb import AebStack

_LIBC = ctypes.CDLL(None, use_errno=True)
_PTRACE_SEIZE = 0x4206
_FILL_BYTES = 600_000_000


class CheatingStack(AebStack):
    """Cheats before its first answer in every case, then drives."""

    def __init__(self, slots: int, *, targets: str, **parameters: Any) -> None:
        super().__init__(slots, **parameters)
        self._targets: dict[str, Any] = json.loads(targets)
        self._honest = False

    def reset(self, slot: int, episode: Any) -> None:
        """As the honest stack; and it may cheat again."""
        self._honest = False
        super().reset(slot, episode)

    def step(self, observation: Any) -> list[Any]:
        """As the honest stack."""
        if not self._honest:
            for name, seen in cheat(self._targets):
                print(f"CHEAT {name}: {seen}", flush=True)
            self._honest = True
        return super().step(observation)


def cheat(targets: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Every attempt by name, and what came of it."""
    folder, pid = Path(targets["folder"]), int(targets["pid"])
    attempts: dict[str, Callable[[], str]] = {
        "read the journal": lambda: _read(folder / "conductor.db"),
        "list the run folder": lambda: str(os.listdir(folder)),
        "write into the run folder": lambda: _write(folder / "cheat.txt"),
        "read keys": lambda: _read(Path(targets["secret"])),
        "read /etc/shadow": lambda: _read(Path("/etc/shadow")),
        "link to the journal": lambda: _through_link(folder / "conductor.db"),
        "environment of the worker": lambda: _read(Path(f"/proc/{pid}/environ")),
        "files of the worker": lambda: str(os.listdir(f"/proc/{pid}/fd")),
        "memory of the worker": lambda: _read(Path(f"/proc/{pid}/mem")),
        "signal the worker": lambda: str(os.kill(pid, signal.SIGSTOP)),
        "trace the worker": lambda: _call("ptrace", _PTRACE_SEIZE, pid, 0, 0),
        "shared memory of others": lambda: str(Path("/dev/shm", targets["shared"]).stat()),
        "port of the conductor": lambda: _connect(socket.AF_INET, ("127.0.0.1", targets["port"])),
        "abstract socket": lambda: _connect(socket.AF_UNIX, f"\0{targets['abstract']}"),
        "the network": lambda: _connect(socket.AF_INET, ("192.0.2.1", 80)),
        "powers of another namespace": lambda: _call("unshare", 0x10000000),
        "mount": lambda: _call("mount", b"tmpfs", b"/tmp", b"tmpfs", 0, 0),
        "keys of the kernel": lambda: _call("syscall", 250, 0, -3, 0, 0, 0),
    }
    for name, attempt in attempts.items():
        try:
            yield name, f"REACHED {attempt()[:200]}"
        except OSError as error:
            yield name, error.strerror or str(error)
    secrets = [name for name, value in os.environ.items() if value == targets["word"]]
    yield "secrets of the environment", f"REACHED {secrets}" if secrets else "none"
    yield "fill the disk", _fill()
    yield "kill everybody", _kill_everybody()
    _leave_a_daemon()
    yield "leave a daemon", "left"


def _read(path: Path) -> str:
    with path.open("rb") as file:
        return repr(file.read(20))


def _write(path: Path) -> str:
    path.write_text("cheat", encoding="utf-8")
    return "written"


def _through_link(target: Path) -> str:
    with tempfile.TemporaryDirectory() as scratch:
        link = Path(scratch, "link")
        link.symlink_to(target)
        return _read(link)


def _connect(family: int, place: Any) -> str:
    with socket.socket(family) as line:
        line.settimeout(2)
        line.connect(place)
        return "connected"


def _call(name: str, *given: Any) -> str:
    ctypes.set_errno(0)
    if getattr(_LIBC, name)(*given) == -1:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return "allowed"


def _fill() -> str:
    """A scratch takes what fits."""
    written, path = 0, Path(tempfile.gettempdir(), "fill")
    try:
        with path.open("wb") as file:
            while written < _FILL_BYTES:
                written += file.write(bytes(1 << 20))
    except OSError as error:
        return error.strerror or str(error)
    finally:
        path.unlink(missing_ok=True)
    return f"REACHED {written} bytes"


def _kill_everybody() -> str:
    """All that this process may signal; what starts and watches it is none of that."""
    with contextlib.suppress(OSError):
        os.kill(-1, signal.SIGKILL)
    with contextlib.suppress(OSError):
        os.kill(os.getppid(), signal.SIGKILL)
    return "tried"


def _leave_a_daemon() -> None:
    command = "import time; time.sleep(615)"
    subprocess.Popen(
        [sys.executable, "-c", command], start_new_session=True, stdin=subprocess.DEVNULL
    )
