"""Gathers the facts of ``hpc doctor``."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import sys
from pathlib import Path

import psutil

from hpc.backends import backend, present, programs
from hpc.commands import call, exists
from hpc.doctor import Address, Facts
from hpc.scheduler import Partitions
from hpc.site import usual_path
from hpc.submit import probe
from schemas.kinds.batch_system import BatchSystemKind, batch_systems
from twin.base.errors import TwinError
from twin.base.files import filesystem, nearest_existing

WAIT_S = 20.0
"""Longest wait for one program [s]."""


def look(folder: Path, site: Path | None) -> Facts:
    """Everything about this host; ``folder`` is where runs would be kept."""
    system = present()
    offered = backend(system.name).partitions(WAIT_S) if system is not None else Partitions()
    there = nearest_existing(folder)
    beside = Path(sys.executable).parent
    used = site or usual_path()
    return Facts(
        scheduler=system.name if system is not None else "",
        looked_for=tuple(programs()),
        unusable=tuple(batch_systems().broken.values()),
        version=_version(system),
        answers=offered.trouble,
        partitions=offered.partitions,
        gpus=_gpus(),
        containers=_containers(),
        folder=str(folder),
        filesystem=filesystem(there),
        writable=_writable(folder),
        free_bytes=shutil.disk_usage(there).free,
        quota=_quota(),
        addresses=_addresses(),
        port=_port(),
        python=sys.version_info[:3],
        missing=tuple(n for n in ("conductor", "twin", "devkit") if not (beside / n).exists()),
        site=str(used) if used.exists() else "",
    )


def _version(system: BatchSystemKind | None) -> str:
    if system is None:
        return ""
    done = call(*system.version, wait_s=WAIT_S)
    line = done.out or done.err if not done.code else ""
    return line.strip().splitlines()[0] if line.strip() else f"{system.name}, version unknown"


def _gpus() -> tuple[str, ...]:
    if not exists("nvidia-smi"):
        return ()
    with contextlib.suppress(TwinError):
        done = call("nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader")
        return tuple(done.out.strip().splitlines()) if not done.code else ()
    return ()


def _containers() -> tuple[str, ...]:
    runtimes = []
    for program in ("apptainer", "singularity", "ch-run", "podman"):
        if exists(program):
            with contextlib.suppress(TwinError):
                done = call(program, "--version", wait_s=WAIT_S)
                version = re.search(r"\b\d+\.\d[\w.~-]*", done.out + done.err)
                runtimes.append(f"{program} {version[0]}" if version else program)
    return tuple(runtimes)


def _writable(folder: Path) -> str:
    made = [ancestor for ancestor in (folder, *folder.parents) if not ancestor.exists()]
    try:
        probe(folder)
    except TwinError as error:
        return str(error).removesuffix("; nothing was submitted")
    finally:
        with contextlib.suppress(OSError):
            for created in made:
                created.rmdir()
    return ""


def _quota() -> str:
    if not exists("quota"):
        return ""
    with contextlib.suppress(TwinError):
        lines = call("quota", "-s", "-w", wait_s=WAIT_S).out.strip().splitlines()
        return "; ".join(" ".join(line.split()) for line in lines[2:])
    return ""


def _addresses() -> tuple[Address, ...]:
    return tuple(
        Address(name, address.address)
        for name, addresses in sorted(psutil.net_if_addrs().items())
        for address in addresses
        if address.family == socket.AF_INET
    )


def _port() -> str:
    try:
        with socket.socket() as probe_socket:
            probe_socket.bind(("", 0))
            probe_socket.listen()
    except OSError as error:
        return f"no port can be listened at: {error.strerror or os.strerror(error.errno or 0)}"
    return ""
