"""What the facts of a machine mean for campaigns, and what to do about them. Pure.

:mod:`conductor.doctor.look` gathers the :class:`MachineFacts`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schemas.words import counted
from twin.base.files import IN_MEMORY, SHARED

Level = Literal["ok", "warn", "bad"]

SPACE_BAD_BYTES = 256 << 20
"""Less free space than this does not take a campaign's results [bytes]."""
SPACE_WARN_BYTES = 5 << 30
"""Less free space than this ends campaigns with recordings [bytes]."""
MEMORY_BAD_BYTES = 1 << 30
"""Less memory than this does not take a worker [bytes]."""
MEMORY_WARN_BYTES = 4 << 30
"""Less memory than this takes one worker only [bytes]."""
FILES_MIN = 1024
"""Fewer files that a process may have open are too few for a conductor with many workers."""
YEAR_MIN = 2026
"""The year of this software; a clock before it makes certificates that nobody accepts."""
PYTHONS = ((3, 11), (3, 14))
"""The first version of Python that is supported, and the first that is not."""


@dataclass(frozen=True, slots=True)
class WarpCuda:
    """CUDA as Warp finds it."""

    toolkit: str = ""
    """Version of the CUDA that Warp was built with."""
    driver: str = ""
    """Newest CUDA that the driver can do; empty: no driver."""
    devices: tuple[str, ...] = ()
    trouble: str = ""
    """Why Warp does not start, in a line; empty: it does."""


@dataclass(frozen=True, slots=True)
class Package:
    """A library that the distribution declares."""

    name: str
    wanted: str
    """What is declared, e.g. ``~=2.4``."""
    found: str
    """Installed version; empty: none."""
    fits: bool
    pinned: str = ""
    """Version of the lock file, where one is beside the sources; empty: none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFacts:
    """Facts of this machine."""

    python: tuple[int, int, int]
    distributions: tuple[str, ...]
    """Distributions of ours that are installed."""
    packages: tuple[Package, ...]
    processor: str
    """Its device class, e.g. ``cpu:x86_64+avx2+fma``."""
    gpus: tuple[str, ...]
    driver: str
    """Version of the NVIDIA driver; empty: none."""
    driver_trouble: str
    """Why a driver that is installed does not answer; empty: it does, or none is installed."""
    warp: WarpCuda
    vulkan: bool
    sandbox: str
    """Why stacks have no sandbox; empty: they have one."""
    port: int
    port_trouble: str
    """Why nobody can listen at ``port``; empty: one can."""
    folder: str
    """Where runs would be kept."""
    filesystem: str
    folder_trouble: str
    """Why no file can be written, synced and locked there; empty: it can."""
    free_bytes: int
    cache_trouble: str
    """Why the cache is not believed; empty: it is."""
    memory_bytes: int
    """Memory that this process may use now [bytes]."""
    files_max: int
    clock_year: int
    clock_synchronised: bool | None
    """Whether the kernel says so; None: it does not tell."""
    browser: str
    """Path of Chromium; empty: none."""
    schedulers: tuple[str, ...]
    """Batch systems whose commands are here."""


@dataclass(frozen=True, slots=True)
class MachineLine:
    """One line: what was looked at, how it is, what to do, and the page that says more."""

    what: str
    level: Level
    found: str
    do: str = ""
    page: str = ""


def findings(facts: MachineFacts) -> list[MachineLine]:
    """All lines, in a fixed order."""
    return [
        _python(facts),
        *_distributions(facts),
        *_packages(facts),
        _processor(facts),
        *_gpu(facts),
        _vulkan(facts),
        _sandbox(facts),
        _port(facts),
        *_folder(facts),
        _cache(facts),
        _memory(facts),
        _files(facts),
        _clock(facts),
        _browser(facts),
        _schedulers(facts),
    ]


def _python(facts: MachineFacts) -> MachineLine:
    version = ".".join(map(str, facts.python))
    first, beyond = PYTHONS
    if first <= facts.python[:2] < beyond:
        return MachineLine("Python", "ok", version)
    do = f"use Python {first[0]}.{first[1]} up to {beyond[0]}.{beyond[1] - 1}"
    return MachineLine("Python", "bad", version, do, "README.md#start")


def _distributions(facts: MachineFacts) -> list[MachineLine]:
    """Nothing, unless several of ours overwrite each other's files."""
    if len(facts.distributions) < 2:
        return []
    found = f"{' and '.join(facts.distributions)} are installed, and own the same files"
    do = f"pip uninstall {' '.join(facts.distributions)}, then pip install one of them"
    return [MachineLine("distributions", "bad", found, do, "docs/versions.md#two-distributions")]


def _packages(facts: MachineFacts) -> list[MachineLine]:
    page = "docs/compatibility.md"
    missing = [p for p in facts.packages if not p.found]
    unfit = [p for p in facts.packages if p.found and not p.fits]
    moved = [p for p in facts.packages if p.fits and p.pinned and p.pinned != p.found]
    lines = [
        MachineLine("library", "bad", f"{p.name} is not installed", "install drivetwin again", page)
        for p in missing
    ]
    lines += [
        MachineLine(
            "library",
            "bad",
            f"{p.name} {p.found}, needed is {p.wanted}",
            f"pip install '{p.name}{p.wanted}'",
            page,
        )
        for p in unfit
    ]
    if moved:
        names = ", ".join(f"{p.name} {p.found} instead of {p.pinned}" for p in moved)
        do = "`make install` installs what is pinned; results of other versions may differ"
        lines.append(MachineLine("library", "warn", names, do, page))
    fitting = len(facts.packages) - len(missing) - len(unfit)
    return [*lines, MachineLine("libraries", "ok", f"{fitting} of {len(facts.packages)} fit")]


def _processor(facts: MachineFacts) -> MachineLine:
    if facts.processor == "cpu:x86_64+avx2+fma":
        return MachineLine("processor", "ok", facts.processor)
    do = "results of networks may differ from those of other machines"
    return MachineLine("processor", "warn", facts.processor, do, "docs/compatibility.md")


def _gpu(facts: MachineFacts) -> list[MachineLine]:
    page = "docs/gpu.md"
    if facts.driver_trouble:
        do = "repair the NVIDIA driver (`nvidia-smi` must work); until then use --device cpu"
        return [MachineLine("GPU", "bad", facts.driver_trouble, do, page)]
    if facts.warp.trouble:
        do = "install warp-lang again"
        return [MachineLine("Warp", "bad", facts.warp.trouble, do, "docs/compatibility.md")]
    if not facts.gpus:
        return [MachineLine("GPU", "ok", "none; cases run on the processor", page=page)]
    shown = f"{', '.join(facts.gpus)}; driver {facts.driver}"
    lines = [MachineLine("GPU", "ok", shown, page=page)]
    cuda = facts.warp
    if not cuda.devices:
        do = f"Warp needs a driver for CUDA {cuda.toolkit}: update it, or use --device cpu"
        return [*lines, MachineLine("CUDA", "bad", "Warp finds no GPU", do, page)]
    found = f"driver {cuda.driver}, Warp is built with {cuda.toolkit}"
    if int(cuda.driver.partition(".")[0]) < int(cuda.toolkit.partition(".")[0]):
        do = "update the driver: Warp's kernels are compiled for a newer CUDA"
        return [*lines, MachineLine("CUDA", "warn", found, do, page)]
    return [*lines, MachineLine("CUDA", "ok", found)]


def _vulkan(facts: MachineFacts) -> MachineLine:
    if facts.vulkan:
        return MachineLine("Vulkan", "ok", "a driver is installed")
    do = "apt-get install mesa-vulkan-drivers; without it `viewer shot` renders nothing"
    return MachineLine("Vulkan", "warn", "no driver", do, "docs/viewer.md")


def _sandbox(facts: MachineFacts) -> MachineLine:
    if not facts.sandbox:
        return MachineLine("sandbox", "ok", "bubblewrap starts; stacks are kept apart")
    found, _, do = facts.sandbox.partition("; ")
    return MachineLine("sandbox", "warn", found, do or "stacks run unprotected", "docs/sandbox.md")


def _port(facts: MachineFacts) -> MachineLine:
    if not facts.port_trouble:
        return MachineLine("port", "ok", f"{facts.port} is free")
    do = "give `conductor serve --listen` another port, or end what listens there"
    return MachineLine("port", "warn", facts.port_trouble, do, "docs/security.md")


def _folder(facts: MachineFacts) -> list[MachineLine]:
    page = "docs/cluster.md"
    if facts.folder_trouble:
        do = "choose another folder with --out"
        return [MachineLine("run folder", "bad", facts.folder_trouble, do, page)]
    where = f"{facts.folder} on {facts.filesystem}"
    if facts.filesystem in IN_MEMORY:
        do = "it is gone after a restart; choose another folder with --out"
        lines = [MachineLine("run folder", "warn", where, do, page)]
    elif facts.filesystem in SHARED:
        do = "let one conductor at a time use it; its journal is faster on a local disk"
        lines = [MachineLine("run folder", "warn", f"{where}, a network file system", do, page)]
    else:
        lines = [MachineLine("run folder", "ok", f"{where}: written, synced and locked")]
    free = f"{facts.free_bytes / (1 << 30):.1f} GiB free"
    level: Level = "ok"
    if facts.free_bytes < SPACE_WARN_BYTES:
        level = "bad" if facts.free_bytes < SPACE_BAD_BYTES else "warn"
    do = "" if level == "ok" else "free some space, or choose another folder with --out"
    return [*lines, MachineLine("space", level, free, do, "docs/limits.md" if do else "")]


def _cache(facts: MachineFacts) -> MachineLine:
    if not facts.cache_trouble:
        return MachineLine("cache", "ok", "nobody else can write to it")
    do = "name a folder of your own with TWIN_CACHE"
    return MachineLine("cache", "bad", facts.cache_trouble, do, "docs/containers.md")


def _memory(facts: MachineFacts) -> MachineLine:
    found = f"{facts.memory_bytes / (1 << 30):.1f} GiB available"
    if facts.memory_bytes >= MEMORY_WARN_BYTES:
        return MachineLine("memory", "ok", found)
    if facts.memory_bytes >= MEMORY_BAD_BYTES:
        return MachineLine("memory", "warn", found, "run with --workers 1", "docs/limits.md")
    do = "end other programs, or use a larger machine: a worker needs about 1 GiB"
    return MachineLine("memory", "bad", found, do, "docs/limits.md")


def _files(facts: MachineFacts) -> MachineLine:
    found = f"{facts.files_max} may be open in a process"
    if facts.files_max >= FILES_MIN:
        return MachineLine("files", "ok", found)
    do = f"have the hard limit raised to {FILES_MIN} (ulimit -Hn, or limits.conf)"
    return MachineLine("files", "warn", found, do, "docs/limits.md")


def _clock(facts: MachineFacts) -> MachineLine:
    page = "docs/security.md"
    if facts.clock_year < YEAR_MIN:
        do = "set the clock: keys and certificates made now are refused elsewhere"
        return MachineLine("clock", "bad", f"the year is {facts.clock_year}", do, page)
    if facts.clock_synchronised is False:
        do = "start a time service (chrony, systemd-timesyncd) where several hosts work together"
        return MachineLine("clock", "warn", "not synchronised", do, page)
    found = "synchronised" if facts.clock_synchronised else "the kernel does not tell"
    return MachineLine("clock", "ok", found)


def _browser(facts: MachineFacts) -> MachineLine:
    if facts.browser:
        return MachineLine("browser", "ok", facts.browser)
    do = "apt-get install chromium; only `viewer bench --page` and tests need it"
    return MachineLine("browser", "ok", "no Chromium", do, "docs/viewer.md")


def _schedulers(facts: MachineFacts) -> MachineLine:
    if not facts.schedulers:
        return MachineLine("batch system", "ok", "none", page="docs/cluster.md")
    found = f"{counted(len(facts.schedulers), 'batch system')}: {', '.join(facts.schedulers)}"
    return MachineLine("batch system", "ok", found, "`hpc doctor` says more", "docs/cluster.md")
