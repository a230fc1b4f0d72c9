"""A way to a conductor behind ssh: the tunnel is a child of ours, opened, mended and ended by us.

The far end runs ``cat``: it says when the tunnel stands, and ends with our end of its input,
however we end. Passwords are asked for on the terminal, by ssh itself; to mend a tunnel that fell,
keys or an agent are needed.
"""

from __future__ import annotations

import dataclasses
import os
import shlex
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from schemas.files.json_text import JsonError, decode_json
from twin.base.errors import InfrastructureError, UnreachableError, UsageError
from twin.fabric.discovery import FILE_NAME, ConductorFile, Target, agreed_namespace
from twin.fabric.endpoint import check_endpoint, host_and_port, is_loopback, is_tls
from twin.fabric.keys.key_file import UnfitKeyError, load_key
from twin.fabric.keys.roles import Role
from viewer.playback import native

READY = "drivetwin-tunnel-stands"
"""What the far end says first."""

NOISE_LINES_MAX = 1000
"""What start-up files over there may print before, at most."""

PAUSE_S = 5.0
"""Shortest time between two tries: servers lock out who knocks too often [s]."""

READ_S = 60.0
"""Longest time a file over there may take to come, passwords included [s]."""

_UNFIT = frozenset("'\"`$;&<>|(){}")
"""Characters of no host's name: ssh hands names to shells, as it does with -J."""

_OPTIONS = (
    *("-o", "ExitOnForwardFailure=yes", "-o", "ConnectTimeout=15"),
    # A line that is down is noticed after 15 s.
    *("-o", "ServerAliveInterval=5", "-o", "ServerAliveCountMax=3"),
)


@dataclass(frozen=True, slots=True)
class Far:
    """Place of the conductor, as ssh and the far end see it."""

    login: str
    """``me@login``, as ssh takes it."""
    node: str = ""
    """Host behind it that the tunnel ends at; empty: where the conductor listens."""
    connect: str = ""
    """Endpoint of the conductor over there; empty: :attr:`folder` says it."""
    folder: str = ""
    """The folder over there that holds its ``conductor.json``."""

    def __post_init__(self) -> None:
        for name in (self.login, self.node):
            _check_host(name)


class Tunnel:
    """One tunnel; :meth:`target` may be called again whenever it may have broken."""

    def __init__(
        self, far: Far, namespace: str, key: Path | None, role: Role = Role.viewer
    ) -> None:
        """Check that a tunnel can be tried.

        Raises:
            UsageError: there is no ssh here, or no such key.
        """
        if shutil.which("ssh") is None:
            raise UsageError("--ssh: there is no ssh on this machine; install OpenSSH's client")
        if far.connect:
            check_endpoint(far.connect)
        self._far = far
        self._key = load_key(key, role) if key is not None else None
        self._fetched_from = ""
        """Path of the key over there; empty: it was given here."""
        self._namespace = agreed_namespace(namespace, self._key)
        self._role = role
        self._child: subprocess.Popen[bytes] | None = None
        self._end_here: Target | None = None
        """What :meth:`target` gave last; None: no tunnel stands."""
        self._to = ""
        """Endpoint over there that the child forwards to."""
        self._port = 0
        self._stood = False
        """Whether the tunnel has been open once; what fails then may come back."""
        self._called_s = float("-inf")
        self._closed = False

    def target(self) -> Target:
        """End of the tunnel on this host, which stands now.

        Raises:
            InfrastructureError: ssh does not get there.
            UnreachableError: it got there before, or no conductor serves the folder yet.
            UsageError: the conductor cannot be reached this way.
        """
        self._pause()
        conductor = self._look_up()
        if is_tls(conductor.endpoint) and (self._key is None or self._fetched_from):
            self._fetch_key(conductor)
        if self._child is None or self._child.poll() is not None or self._to != conductor.endpoint:
            self._end()
            self._open(conductor)
        endpoint = f"{conductor.endpoint.partition('/')[0]}/127.0.0.1:{self._port}"
        self._end_here = Target(endpoint, conductor.namespace, self._key)
        return self._end_here

    def standing(self) -> Target:
        """End of the tunnel on this host, at once; any thread may ask while another one digs.

        Raises:
            UnreachableError: it does not stand.
        """
        target, child = self._end_here, self._child
        if target is None or child is None or child.poll() is not None:
            raise UnreachableError(f"the tunnel to {self._far.login} does not stand")
        return target

    def close(self) -> None:
        """End the tunnel for good."""
        self._closed = True
        self._end()

    def _end(self) -> None:
        child, self._child, self._end_here = self._child, None, None
        if child is None:
            return
        if child.stdin is not None:
            child.stdin.close()
        child.terminate()
        try:
            child.wait(2.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()

    @property
    def _options(self) -> tuple[str, ...]:
        """Once it has stood nobody is asked for a password: the terminal is in use by then."""
        return (*_OPTIONS, "-o", "BatchMode=yes") if self._stood else _OPTIONS

    def _look_up(self) -> ConductorFile:
        """What ``conductor.json`` over there says, or the command line."""
        far = self._far
        if far.connect:
            return ConductorFile(far.connect, 0, far.node, 0, self._namespace, "")
        path = f"{far.folder}/{FILE_NAME}"
        data = self._read(path)
        if data is None:
            raise UnreachableError(f"{far.login}:{path}: no conductor serves this folder")
        try:
            # Whatever start-up files over there print stands before it.
            text = data[max(0, data.find(b"{")) :]
            conductor = decode_json(text, ConductorFile)
        except JsonError as error:
            raise UnreachableError(f"{far.login}:{path}: damaged: {error}") from None
        try:
            check_endpoint(conductor.endpoint)
            _check_host(conductor.host)
        except UsageError as error:
            raise UsageError(f"{far.login}:{path}: {error}") from None
        return conductor

    def _read(self, path: str) -> bytes | None:
        """A file over there; None: it cannot be read."""
        far = self._far
        try:
            done = subprocess.run(
                ["ssh", *self._options, "--", far.login, f"cat -- {shlex.quote(path)}"],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=READ_S,
            )
        except subprocess.TimeoutExpired:
            raise self._failed(f"no answer after {READ_S:g} s") from None
        if done.returncode == 255:  # of ssh itself
            raise self._failed(done.stderr.decode("utf-8", "replace"))
        return None if done.returncode else done.stdout

    def _fetch_key(self, conductor: ConductorFile) -> None:
        """Fetch the key: a login as the conductor's user may read it. No person copies it, and here
        it is in memory only."""
        path = f"{conductor.key}/{self._role}.key" if conductor.key else ""
        if self._key is not None and path == self._fetched_from:
            return
        data = self._read(path) if path else None
        if data is None:
            raise UsageError(f"{conductor.endpoint}: needs a key of the fabric; {self._key_hint()}")
        descriptor = os.memfd_create("key", os.MFD_CLOEXEC)
        try:
            os.fchmod(descriptor, 0o600)
            os.write(descriptor, data)
            read = load_key(Path(f"/proc/self/fd/{descriptor}"), self._role)
        except UnfitKeyError as error:
            why = str(error).partition(": ")[2]
            raise UnfitKeyError(f"{self._far.login}:{path}: {why}") from None
        finally:
            os.close(descriptor)
        self._key = dataclasses.replace(read, path=Path(f"{self._far.login}:{path}"))
        self._fetched_from = path

    def _open(self, conductor: ConductorFile) -> None:
        far = self._far
        host, port = host_and_port(conductor.endpoint)
        if host in ("0.0.0.0", "::"):
            host = conductor.host or "127.0.0.1"
        node = far.node or (conductor.host if is_loopback(conductor.endpoint) else "")
        user = far.login.rpartition("@")[0]
        behind = f"{user}@{node}" if user and "@" not in node else node
        way = ["-J", far.login, "--", behind] if node else ["--", far.login]
        self._port = native.free_port()
        with tempfile.TemporaryFile() as log:
            self._child = child = subprocess.Popen(
                [
                    *("ssh", *self._options, "-L", f"127.0.0.1:{self._port}:{host}:{port}", *way),
                    f"echo {READY} && exec cat",
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
            )
            assert child.stdout is not None
            if self._closed:  # while we looked over there: nobody else would end it
                self._end()
                raise self._shut()
            for _ in range(NOISE_LINES_MAX):
                try:
                    line = child.stdout.readline()
                except ValueError:  # it was closed meanwhile, by whoever closed the tunnel
                    raise self._shut() from None
                if READY.encode() in line:
                    break
                if not line:
                    child.wait()
                    if self._closed:
                        raise self._shut()
                    log.seek(0)
                    raise self._failed(log.read().decode("utf-8", "replace"))
        self._to, self._stood = conductor.endpoint, True

    def _key_hint(self) -> str:
        far = self._far
        if not far.folder:
            return "ask for one (`conductor invite --role viewer`) and give --key FILE"
        name = f"{self._role}.key"
        state = shlex.quote(far.folder)
        looks = "; one of the role viewer looks only" if self._role is Role.admin else ""
        return (
            f"{far.login} has none that you may read; have one made by whoever started it "
            f"(`conductor invite --role {self._role} --state {state} -o {name}`), copy it and give "
            f"--key {name}{looks}"
        )

    def _pause(self) -> None:
        until_s = self._called_s + PAUSE_S
        while not self._closed and time.monotonic() < until_s:
            time.sleep(0.05)
        if self._closed:
            raise self._shut()
        self._called_s = time.monotonic()

    def _shut(self) -> UnreachableError:
        return UnreachableError(f"the tunnel to {self._far.login} is closed")

    def _failed(self, text: str) -> InfrastructureError:
        last = (text.strip().splitlines() or ["it ended without a word"])[-1].strip()
        kind = UnreachableError if self._stood else InfrastructureError
        way = f"{self._far.login}, {self._far.node}" if self._far.node else self._far.login
        return kind(f"ssh {way}: {last[:200]}")


def _check_host(name: str) -> None:
    """Raise UsageError if ssh would take ``name`` for an option or a shell for a command."""
    if name.startswith("-") or any(c.isspace() or c in _UNFIT for c in name):
        raise UsageError(f"'{name}': expected a host as ssh takes it, e.g. me@login1")
