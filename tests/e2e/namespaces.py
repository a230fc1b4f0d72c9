"""Hosts of a test: network namespaces in a row, each joined by a cable to the next only."""

from __future__ import annotations

import os
import shutil
import subprocess
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import pytest


@dataclass(slots=True)
class Host:
    """One namespace."""

    name: str
    addresses: list[str] = field(default_factory=list)
    """Towards the host before and the host after, where there are such."""

    @property
    def inside(self) -> tuple[str, ...]:
        """Words before a command that runs there."""
        return ("ip", "netns", "exec", self.name)


@contextmanager
def hosts_in_a_row(count: int) -> Iterator[list[Host]]:
    """``count`` hosts that do not forward: each reaches its neighbours and nobody else."""
    if shutil.which("ip") is None:
        pytest.skip("needs the Debian package iproute2")
    if os.geteuid() != 0:
        pytest.skip("needs root for network namespaces")
    tag = uuid.uuid4().hex[:6]
    hosts = [Host(f"tw{tag}{index}") for index in range(count)]
    made = []
    try:
        for host in hosts:
            _ip("netns", "add", host.name)
            made.append(host.name)
            _ip("-n", host.name, "link", "set", "lo", "up")
        for index in range(count - 1):
            _cable(f"v{tag}{index}", index, hosts[index], hosts[index + 1])
        yield hosts
    finally:
        for name in made:
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def _cable(tag: str, index: int, one: Host, two: Host) -> None:
    peer = ("type", "veth", "peer", f"{tag}b", "netns", two.name)
    _ip("link", "add", f"{tag}a", "netns", one.name, *peer)
    for host, end in ((one, "a"), (two, "b")):
        address = f"10.77.{9 + index}.{1 if end == 'a' else 2}"
        _ip("-n", host.name, "addr", "add", f"{address}/24", "dev", f"{tag}{end}")
        _ip("-n", host.name, "link", "set", f"{tag}{end}", "up")
        host.addresses.append(address)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
