"""A private Slurm whose nodes have a network, a host name and processes of their own; needs root.

Each node is a ``slurmd`` in namespaces, joined to the others by a bridge. A node can be cut off
(its cable is pulled, its processes go on) or switched off (the cable first, so that nobody hears
its sockets close, then every process).
"""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import subprocess

import slurm_cluster
from slurm_cluster import NODES, SlurmCluster


def missing() -> str:
    """Why there can be no such cluster here, or nothing."""
    absent = [name for name in ("ip", "nsenter", "unshare") if shutil.which(name) is None]
    if absent:
        return f"needs {' '.join(absent)} (Debian packages iproute2, util-linux)"
    if os.geteuid() != 0:
        return "needs root for network namespaces"
    return slurm_cluster.missing()


class NamespacedCluster(SlurmCluster):
    """Three nodes at addresses of their own."""

    def __init__(self) -> None:
        super().__init__()
        self._tag = self.mark[:5]
        self._network = f"10.78.{random.SystemRandom().randrange(1, 255)}"
        self.address = f"{self._network}.254"
        self.network = f"{self._network}.0/24"

    def start(self) -> None:
        """Bridge, cables and namespaces first."""
        bridge = f"b{self._tag}"
        _ip("link", "add", bridge, "type", "bridge")
        _ip("addr", "add", f"{self.address}/24", "dev", bridge)
        _ip("link", "set", bridge, "up")
        for number, node in enumerate(NODES, 1):
            name, cable = self._name(node), self._cable(node)
            _ip("netns", "add", name)
            _ip("link", "add", cable, "type", "veth", "peer", "name", "eth0", "netns", name)
            _ip("link", "set", cable, "master", bridge, "up")
            _ip("-n", name, "addr", "add", f"{self._network}.{number}/24", "dev", "eth0")
            _ip("-n", name, "link", "set", "eth0", "up")
            _ip("-n", name, "link", "set", "lo", "up")
        super().start()

    def stop(self) -> None:
        """The network goes after the processes; cables before namespaces."""
        try:
            super().stop()
        finally:
            for node in NODES:
                _ip("link", "del", self._cable(node), check=False)
            for node in NODES:
                _ip("netns", "del", self._name(node), check=False)
            _ip("link", "del", f"b{self._tag}", check=False)

    def place(self, node: str, port: int) -> str:
        """Where a node is, in the words of slurm.conf."""
        address = f"{self._network}.{NODES.index(node) + 1}"
        return f"NodeHostname={node} NodeAddr={address} Port={port}"

    def node_command(self, node: str) -> tuple[str, ...]:
        """A daemon in namespaces; with the outer process everything inside ends."""
        inside = f"hostname {node}; {shutil.which('slurmd', path=_SEARCH)} -D -N {node} & wait"
        return (
            *("nsenter", f"--net=/run/netns/{self._name(node)}"),
            *("unshare", "--pid", "--fork", "--kill-child", "--mount-proc", "--uts"),
            *("bash", "-c", inside),
        )

    def end_daemon(self, daemon: subprocess.Popen[bytes]) -> None:
        """``unshare`` passes no signal on, but what is inside ends with it."""
        if daemon in self._nodes.values():
            daemon.kill()
        else:
            super().end_daemon(daemon)

    def cut(self, node: str) -> None:
        """Pull its cable."""
        _ip("link", "set", self._cable(node), "down")

    def mend(self, node: str) -> None:
        """Plug it in again."""
        _ip("link", "set", self._cable(node), "up")

    def switch_off(self, node: str) -> None:
        """Nobody hears of it."""
        self.cut(node)
        daemon = self._nodes[node]
        daemon.kill()
        daemon.wait()
        self._daemons.remove(daemon)

    def _name(self, node: str) -> str:
        return f"s{self._tag}{node}"

    def _cable(self, node: str) -> str:
        return f"v{self._tag}{node}"


_SEARCH = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"


def _ip(*arguments: str, check: bool = True) -> None:
    with contextlib.nullcontext() if check else contextlib.suppress(OSError):
        subprocess.run(["ip", *arguments], check=check, capture_output=True)
