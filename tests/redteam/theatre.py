"""Where an attack takes place: a folder, keys and processes of its own, and a second user."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgpack
from processes import Marked, keys_of, wait_for

from schemas import SCHEMA_VERSION
from twin.base.errors import TwinError
from twin.fabric.bus import Bus
from twin.fabric.discovery import find_conductor
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

NOBODY = 65534
"""The second user: neither root nor the one who runs."""

_BECOME = """
import encodings.idna, json, os, socket, sys, time, urllib.error, urllib.request
from pathlib import Path
if {uid}:
    os.setgroups([]); os.setgid({uid}); os.setuid({uid})
"""


class Theatre:
    """Used as a context; nothing of it outlives the block."""

    def __init__(self, minutes: float = 1.0, cases: int = 2) -> None:
        """``minutes``: how long an attack goes on whose strength is its length; ``cases``: how many
        a stack drives that cheats in each of them, an even number."""
        self.minutes = minutes
        self.cases = cases
        self.marked = Marked()
        self.folder = Path(tempfile.mkdtemp(prefix="redteam-", dir="/tmp"))
        self.folder.chmod(0o755)  # another user comes this far
        self.state = self.folder / "state"
        self.secret = self.folder / "secret"
        """A file that nobody else may read."""
        self._home = os.environ.get("DRIVETWIN_HOME")
        self._buses: list[Bus] = []

    def __enter__(self) -> Self:
        """Keys of this theatre alone."""
        os.environ["DRIVETWIN_HOME"] = str(self.folder / "home")
        self.secret.touch(0o600)
        self.secret.write_text("a word that nobody else knows")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End what was started."""
        for bus in self._buses:
            bus.close()
        self.marked.end()
        if self._home is None:
            os.environ.pop("DRIVETWIN_HOME", None)
        else:
            os.environ["DRIVETWIN_HOME"] = self._home
        shutil.rmtree(self.folder, ignore_errors=True)

    # --- the victim -----------------------------------------------------------------------------

    def serve(self, *options: str) -> subprocess.Popen[str]:
        """Start ``conductor serve``, and wait until it listens."""
        log = (self.folder / "serve.log").open("w")
        where = ("--state", str(self.state))
        child = self.marked.start("conductor", "serve", *where, *options, log=log)

        def listens() -> bool:
            assert child.poll() is None, self.said()
            try:
                return find_conductor(self.state).pid == child.pid
            except TwinError:
                return False

        wait_for(listens, "the conductor")
        return child

    def said(self) -> str:
        """What the conductor said."""
        return (self.folder / "serve.log").read_text()

    def write(self, name: str, text: str) -> Path:
        """A file of the victim."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def submit(self, name: str, cases: int = 4) -> None:
        """A campaign that simulates nothing, by who may."""
        path = self.write(f"{name}.yaml", noop(name, cases))
        done = self.command("submit", str(path))
        assert done.returncode == 0, done.stderr

    def command(self, *words: str) -> subprocess.CompletedProcess[str]:
        """``conductor WORDS`` at the conductor, as the user who runs."""
        return self.marked.run("conductor", *words, "--state", str(self.state))

    # --- the attackers --------------------------------------------------------------------------

    def invite(self, role: str) -> Path:
        """A key of ``role``, as somebody gets it by invitation."""
        path = self.folder / f"{role}-{len(self._buses)}.key"
        done = self.command("invite", "--role", role, "-o", str(path))
        assert done.returncode == 0, done.stderr
        return path

    def member(self, key: Path, role: Role) -> Bus:
        """A session of somebody who minds no rule of ours."""
        endpoint = find_conductor(self.state).endpoint
        bus = open_bus("client", connect=[endpoint], key=load_key(key, role))
        self._buses.append(bus)
        return bus

    def own(self, role: Role) -> Bus:
        """A session of the victim's own."""
        return self.member(keys_of(self.state) / f"{role}.key", role)

    def as_nobody(self, code: str, *words: str) -> str:
        """Run Python as the second user; what it printed."""
        program = _BECOME.format(uid=NOBODY) + code
        done = subprocess.run(
            [sys.executable, "-c", program, *words],
            capture_output=True,
            text=True,
            check=False,
            cwd="/tmp",
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


def noop(name: str, cases: int, autonomy: str = "") -> str:
    """A campaign that simulates nothing."""
    text = f"campaign: {name}\nsimulator: noop\nmatrix: {{repeat: {list(range(cases))}}}\n"
    return f"{text}autonomy: {autonomy}\n" if autonomy else text


def ask(bus: Bus, key: str, timeout_s: float, **message: Any) -> dict[str, Any] | None:
    """The answer to a request that no type of ours has looked at; None: silence."""
    data = msgpack.packb({"v": SCHEMA_VERSION, **message})
    answer = bus.request(key, data, timeout_s)
    if answer is None:
        return None
    found: dict[str, Any] = msgpack.unpackb(answer, strict_map_key=False)
    return found
