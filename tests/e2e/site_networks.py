"""Sites of a test: clusters in network namespaces of their own, each joined by one cable to the
host of the conductor, which is this one. They see no folder of it but their own.

A site may be cut off: its cable is pulled, and whatever works there is killed without a word.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import slurm_namespaces
from slurm_cluster import SlurmCluster


def missing() -> str:
    """Why there can be no sites here, or nothing."""
    if shutil.which("qsub") is None:
        return "needs the Debian package slurm-wlm-torque"
    return slurm_namespaces.missing()


class SiteNetwork:
    """One namespace and its cable."""

    def __init__(self, site: str, number: int, hidden: Path) -> None:
        """``hidden``: folder of this host in whose place its processes see an empty one."""
        self.site = site
        self.there = f"10.79.{number}.1"
        """Its own address."""
        tag = uuid.uuid4().hex[:5]
        self.name, self.cable = f"site{tag}", f"v{tag}"
        self.here = f"10.79.{number}.254"
        """Address of this host, as the site sees it."""
        self.hidden = hidden
        _ip("netns", "add", self.name)
        try:
            _ip("-n", self.name, "link", "set", "lo", "up")
            _ip(
                "link",
                "add",
                self.cable,
                "type",
                "veth",
                "peer",
                "name",
                "eth0",
                "netns",
                self.name,
            )
            _ip("addr", "add", f"{self.here}/24", "dev", self.cable)
            _ip("link", "set", self.cable, "up")
            _ip("-n", self.name, "addr", "add", f"{self.there}/24", "dev", "eth0")
            _ip("-n", self.name, "link", "set", "eth0", "up")
        except BaseException:
            self.remove()
            raise

    @property
    def inside(self) -> tuple[str, ...]:
        """Words before a command there; ``ip netns exec`` would hide /sys/fs/cgroup."""
        return ("nsenter", f"--net=/run/netns/{self.name}")

    @property
    def apart(self) -> tuple[str, ...]:
        """The same, and the folder of this host is hidden."""
        cover = 'mount -t tmpfs none "$0" && exec "$@"'
        return (*self.inside, "unshare", "--mount", "sh", "-c", cover, str(self.hidden))

    def nobody_in(self) -> None:
        """Connections begin inside of it alone."""
        rule = ("iptables", "-A", "INPUT", "-i", "eth0", "-p", "tcp", "--syn", "-j", "DROP")
        # DROP would do; a refusal is seen at once.
        rule = (*rule[:-1], "REJECT", "--reject-with", "tcp-reset")
        subprocess.run([*self.inside, *rule], check=True, capture_output=True)

    def cut(self) -> None:
        """Pull the cable."""
        _ip("link", "set", self.cable, "down")

    def mend(self) -> None:
        """Plug it in again."""
        _ip("link", "set", self.cable, "up")

    def processes(self, word: str) -> list[int]:
        """Processes there whose command line holds ``word``."""
        done = subprocess.run(
            ["ip", "netns", "pids", self.name], check=True, capture_output=True, text=True
        )
        found = []
        for pid in map(int, done.stdout.split()):
            with contextlib.suppress(OSError):
                line = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
                if word.encode() in line:
                    found.append(pid)
        return found

    def remove(self) -> None:
        """The cable goes first."""
        _ip("link", "del", self.cable, check=False)
        _ip("netns", "del", self.name, check=False)


class SiteCluster(SlurmCluster):
    """A private Slurm in such a network."""

    def __init__(self, network: SiteNetwork) -> None:
        super().__init__()
        self.network = network
        self.prefix = network.apart

    @property
    def port(self) -> int:
        """Of its controller."""
        text = (self.folder / "slurm.conf").read_text()
        return int(re.findall("SlurmctldPort=([0-9]+)", text)[0])

    def reach(self, **variables: str) -> list[str]:
        """Words before a line of shell on its login node, as ``ssh`` would be."""
        return [
            *("env", "--ignore-environment", f"PATH={os.environ['PATH']}:/usr/sbin:/sbin"),
            *(f"{name}={os.environ[name]}" for name in ("HOME", "TMPDIR") if name in os.environ),
            *(f"SLURM_CONF={self.environment['SLURM_CONF']}",),
            *(f"WARP_CACHE_PATH={self.environment['WARP_CACHE_PATH']}",),
            *(f"{name}={value}" for name, value in variables.items()),
            *(*self.prefix, "sh", "-c"),
        ]


@contextlib.contextmanager
def networks(names: tuple[str, ...], hidden: Path) -> Iterator[list[SiteNetwork]]:
    """Sites, none of which reaches another."""
    with contextlib.ExitStack() as stack:
        made = []
        for number, name in enumerate(names, 1):
            network = SiteNetwork(name, number, hidden)
            stack.callback(network.remove)
            made.append(network)
        yield made


def own_bin() -> str:
    """Folder of our commands."""
    return str(Path(sys.executable).parent)


def _ip(*arguments: str, check: bool = True) -> None:
    done = subprocess.run(["ip", *arguments], check=False, capture_output=True, text=True)
    assert not check or done.returncode == 0, f"ip {shlex.join(arguments)}: {done.stderr}"
