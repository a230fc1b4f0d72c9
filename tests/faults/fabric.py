"""The rig that faults are injected into: a fabric of real processes on two hosts.

One host has the conductor (and a relay), the other a worker with its simulator and stack (and a
viewer); a wire joins them. Whatever has died is started again by :meth:`Fabric.tend`, as a batch
system or an init would, and campaigns are submitted as long as there is something to inject.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import psutil
import yaml
from broken_store import PORT as STORE_PORT
from fault_campaign import CAMPAIGN, CASES
from host_files import HostFiles
from namespaces import Host, hosts_in_a_row
from object_store import BUCKET, environment
from processes import Marked, keys_of
from wire import Wire

TTL_S = 2.0
"""Leases expire soon, so that frozen workers are seen while a fault lasts."""
PAUSE_S = 0.5
"""Between the death of a process and its next start [s]."""
PORT, RELAY_PORT, NAME = 7447, 7448, "conductor.test"
INSIDE = {"simulator": "sim", "stack": "host", "recorder": "record"}
"""Kinds of process that a worker starts -> word of their command line."""
VIEWS = ("live", "none")
"""Campaigns of one of them share no rig with those of the other; what is shown says the worker."""
EXTRAS = ("viewer", "relay", "recorder", "names", "clock", "store")
"""What a fabric may have beyond the least."""


@dataclass(slots=True)
class Role:
    """A process that is kept alive."""

    command: tuple[str, ...]
    host: Host
    hidden: Path | None = None
    """A folder that it sees empty."""
    child: subprocess.Popen[str] | None = None
    held: int = 0
    """Faults that want it to stay down."""
    zone: str = ""
    """Its time zone; empty: the machine's."""
    due_s: float = 0.0
    """Not to be started before."""

    @property
    def alive(self) -> bool:
        """Whether it runs, or is frozen."""
        return self.child is not None and self.child.poll() is None


@dataclass(slots=True)
class Campaign:
    """A submitted copy of the campaign."""

    folder: Path
    read: int = 0
    """Bytes of its timeline that were read."""
    committed: set[str] = field(default_factory=set)

    def look(self) -> bool:
        """Read on; whether a case was committed since the last look."""
        try:
            with (self.folder / "timeline.jsonl").open("rb") as file:
                if file.seek(0, os.SEEK_END) < self.read:
                    self.read = 0  # a conductor with an empty folder has begun another
                file.seek(self.read)
                data = file.read()
        except FileNotFoundError:
            return False
        before = len(self.committed)
        end = data.rfind(b"\n") + 1
        self.read += end
        for line in data[:end].splitlines():
            with contextlib.suppress(ValueError):  # torn by a kill, or by a full disk
                event = json.loads(line)
                if event["event"] == "committed":
                    self.committed.add(event["case"])
        return len(self.committed) > before

    @property
    def complete(self) -> bool:
        """Every case has ended, as the conductor's file says."""
        try:
            return bool(json.loads((self.folder / "outcomes.json").read_text())["complete"])
        except FileNotFoundError:
            return False


class Fabric:
    """Made by :func:`fabric`."""

    def __init__(
        self, folder: Path, hosts: tuple[Host, Host], extras: frozenset[str], workers: int
    ) -> None:
        self.folder = folder
        self.extras = extras
        self.hosts = hosts
        self.marked = Marked()
        self.files = HostFiles(folder)
        self.state = self.files.disk / "state"
        self.campaigns: list[Campaign] = []
        self.roles: dict[str, Role] = {}
        self._logs: dict[str, IO[str]] = {}
        self._submit: tuple[Path, subprocess.Popen[str]] | None = None
        self._view = 0
        self._workers = workers
        self._wire: Wire | None = None

    @property
    def wire(self) -> Wire:
        """Between the hosts."""
        assert self._wire is not None
        return self._wire

    def start(self, network: str) -> None:
        """Join the hosts and say who is to run where; :meth:`tend` starts them."""
        here, there = self.hosts
        self._wire = Wire(here, there, network)
        endpoint = f"tls/{here.addresses[0]}:{PORT}"
        key = self.folder / "worker.key"
        state = ("--state", str(self.state))
        serve = ("conductor", "serve", *state, "--ttl-s", str(TTL_S), "--listen", endpoint)
        if "store" in self.extras:
            self.break_store({})
            server = (str(Path(__file__).with_name("broken_store.py")), here.addresses[0])
            logs = (str(self._breaks), str(self.folder / "s3.log"))
            self.roles["s3"] = Role((*server, *logs), here)
            # Whoever submitted was told that it is kept, so replies wait for the store.
            serve = (*serve, "--store", f"s3://{BUCKET}/faults", "--durable", "store")
        self.roles["conductor"] = Role(serve, here)
        place, port = here.addresses[0], PORT
        # Without a file system that the hosts share.
        hidden = self.state if self.extras & {"relay", "store"} else None
        if "relay" in self.extras:
            port = RELAY_PORT
            relay = ("conductor", "relay", "--listen", f"tls/{place}:{port}", *state)
            self.roles["relay"] = Role(relay, here)
        if "names" in self.extras:
            server = (str(Path(__file__).with_name("name_server.py")), place, NAME)
            self.roles["dns"] = Role(server, here)
            self.files.resolver.write_text(f"nameserver {place}\noptions timeout:1 attempts:1\n")
            place = NAME
        join: tuple[str, ...] = (*state, "--wait", "60")
        if self.extras & {"relay", "names", "store"}:
            join = ("--connect", f"tls/{place}:{port}", "--key", str(key))
        if "recorder" in self.extras:
            join = (*join, "--view", "record")
        for number in range(self._workers):
            spool = ("--spool", str(self.files.disk / "spool"))
            work = ("twin", "worker", *join, "--slots", "2", *spool)
            self.roles[f"worker-{number}"] = Role(work, there, hidden)
        if "viewer" in self.extras:
            look = ("viewer", "live", "--run", str(self.state), "--no-window")
            self.roles["viewer"] = Role(look, there)

    @property
    def _breaks(self) -> Path:
        return self.folder / "store.json"

    def break_store(self, faults: Mapping[str, float]) -> None:
        """From now on this befalls requests to the store: share by name."""
        fresh = self._breaks.with_suffix(".new")
        fresh.write_text(json.dumps(faults))
        fresh.replace(self._breaks)

    def tend(self, feeding: bool) -> bool:
        """Start what has died, submit if it is time; whether a case was committed meanwhile."""
        now_s = time.monotonic()
        for name, role in self.roles.items():
            if role.alive or role.held:
                continue
            if role.child is not None and not role.due_s:
                role.due_s = now_s + PAUSE_S
            if now_s >= role.due_s and self._may_start(name):
                role.due_s = 0.0
                role.child = self._spawn(name, role)
        if feeding:
            self._feed()
        return sum(campaign.look() for campaign in self.campaigns) > 0

    def _may_start(self, name: str) -> bool:
        """All others need a key that the conductor makes."""
        key = keys_of(self.state) / "worker.key"
        if name in ("conductor", "dns", "s3") or not key.exists():
            return name in ("conductor", "dns", "s3")
        copy = self.folder / "worker.key"
        if not copy.exists():
            copy.touch(0o600)
            copy.write_bytes(key.read_bytes())
        return True

    def prefix(self, role: Role) -> tuple[str, ...]:
        """Words before the command of ``role``."""
        words = (*role.host.inside, *self.files.inside(role.hidden))
        if "store" in self.extras:
            variables = environment(STORE_PORT, self.hosts[0].addresses[0])
            words = (*words, "env", *(f"{name}={value}" for name, value in variables.items()))
        if "clock" in self.extras:
            words = (*words, *self.files.with_clock(role.host.name))
        return (*words, "env", f"TZ={role.zone}") if role.zone else words

    def _spawn(self, name: str, role: Role) -> subprocess.Popen[str]:
        log = self.log(name)
        log.write(f"--- {time.monotonic():.2f} {' '.join(role.command)}\n")
        log.flush()
        if role.command[0].endswith(".py"):
            return subprocess.Popen(
                [*self.prefix(role), sys.executable, *role.command],
                stdout=log,
                stderr=log,
                text=True,
                start_new_session=True,
            )
        return self.marked.start(*role.command, prefix=self.prefix(role), log=log)

    def log(self, name: str) -> IO[str]:
        """What the processes of a role say, one after the other."""
        if name not in self._logs:
            self._logs[name] = (self.folder / f"{name}.log").open("a")
        return self._logs[name]

    def _feed(self) -> None:
        """Submit another copy when few cases are left."""
        if self._submit is not None:
            folder, child = self._submit
            if child.poll() is None:
                return
            self._submit = None
            if child.returncode == 0:
                self.campaigns.append(Campaign(folder))
        open_ones = [campaign for campaign in self.campaigns if not campaign.complete]
        left = sum(CASES - len(campaign.committed) for campaign in open_ones)
        if left > CASES // 2 or not (self.state / "conductor.json").exists():
            return
        name = f"faults-{len(self.campaigns) + 1}"
        path = self.folder / f"{name}.yaml"
        if "recorder" in self.extras and not self.find("recorder"):
            self._view = 1 - self._view  # a rig gets only so many: another is needed
        copy = {**CAMPAIGN, "campaign": name, "view": VIEWS[self._view]}
        path.write_text(yaml.safe_dump(copy))
        role = Role(("conductor", "submit", str(path), "--state", str(self.state)), self.hosts[0])
        child = self.marked.start(*role.command, prefix=self.prefix(role), log=self.log("submit"))
        self._submit = (self.state / name, child)

    def settle(self) -> bool:
        """Whether everything that was submitted has come to its end."""
        if self._submit is not None:
            folder, child = self._submit
            if child.poll() is None:
                return False
            # One that was cut off may have arrived.
            if child.returncode == 0 or (folder / "campaign.yaml").exists():
                self.campaigns.append(Campaign(folder))
            self._submit = None
        return all(campaign.complete for campaign in self.campaigns)

    def find(self, kind: str) -> list[psutil.Process]:
        """Live processes of a kind, in the order in which they were started."""
        if kind not in INSIDE:
            roles = [role for name, role in self.roles.items() if name.startswith(kind)]
            return [psutil.Process(role.child.pid) for role in roles if role.alive and role.child]
        found = []
        for worker in self.find("worker"):
            with contextlib.suppress(psutil.NoSuchProcess):
                for process in worker.children(recursive=True):
                    with contextlib.suppress(psutil.NoSuchProcess, psutil.AccessDenied):
                        if INSIDE[kind] in process.cmdline():
                            found.append(process)
        return sorted(found, key=lambda process: process.create_time())

    def victim(self, kind: str, dice: random.Random) -> psutil.Process | None:
        """One that runs; None: there is none just now."""
        running = [process for process in self.find(kind) if _runs(process)]
        return dice.choice(running) if running else None

    def role_of(self, process: psutil.Process) -> Role | None:
        """The role that it plays; None: a worker started it."""
        roles = self.roles.values()
        return next((r for r in roles if r.child and r.child.pid == process.pid), None)

    def end(self) -> None:
        """SIGTERM to all: workers and viewers before the conductor, as at the end of a job."""
        for name in sorted(self.roles, key=_last):
            child = self.roles[name].child
            if child is not None and child.poll() is None:
                child.terminate()
                child.wait(60)

    def close(self) -> None:
        """Kill what is left."""
        for name in ("dns", "s3"):
            server = self.roles.get(name)
            if server is not None and server.child is not None:
                server.child.kill()
                server.child.wait()
        self.marked.end()
        if self._wire is not None:
            self._wire.close()
        for log in self._logs.values():
            log.close()
        self.files.close()


def _last(name: str) -> int:
    """Which come later at the end of a job."""
    return {"dns": 1, "conductor": 1, "relay": 1, "s3": 2}.get(name, 0)


def _runs(process: psutil.Process) -> bool:
    """Neither frozen nor dead."""
    try:
        return process.status() not in (psutil.STATUS_STOPPED, psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


@contextlib.contextmanager
def fabric(
    folder: Path, extras: frozenset[str] = frozenset(), workers: int = 1
) -> Iterator[Fabric]:
    """A fabric below ``folder``, which is new; nothing of it outlives the block."""
    folder.mkdir(parents=True)
    with hosts_in_a_row(1) as (here,), hosts_in_a_row(1) as (there,):
        made = Fabric(folder, (here, there), extras, workers)
        try:
            made.start("10.79.0")
            yield made
        finally:
            made.close()
