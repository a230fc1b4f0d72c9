"""Installed distributions: whose module a file is, and what a distribution consists of."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import re
import site
import sysconfig
from pathlib import Path

from schemas.kinds.registry import OUR_DISTRIBUTIONS

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def claimants(folder: Path, top: str, *, shared: bool = False) -> list[str]:
    """Names of the distributions in ``folder`` that say that they installed the module ``top``.

    Editable ones say no such thing: their files are elsewhere.

    Args:
        folder: where the module was found.
        top: a module or package, without dots.
        shared: it is a namespace, which several distributions may fill.
    """
    infos = _infos(str(folder), _changed_ns(folder))
    near = [info for info in infos if _plain(info.partition("-")[0]) == _plain(top)]
    owners = [info for info in near if _lists(folder / info, top)]
    if shared or not owners:
        owners = [info for info in infos if _lists(folder / info, top)]
    return sorted(info.partition("-")[0] for info in owners)


def is_site(folder: Path) -> bool:
    """Whether ``folder`` is one where distributions are installed."""
    return folder.name in ("site-packages", "dist-packages") or str(folder) in _sites()


@functools.cache
def _sites() -> frozenset[str]:
    paths = sysconfig.get_paths()
    known = [paths["purelib"], paths["platlib"], *site.getsitepackages()]
    return frozenset([*known, site.getusersitepackages()])


def contents(names: set[str]) -> dict[str, str]:
    """``name version`` of distributions and of what they require, as far as it is installed ->
    SHA-256 over the files that they installed.

    See :func:`record_digest`.
    """
    digests: dict[str, str] = {}
    waiting, reached = sorted(names), set(OUR_DISTRIBUTIONS)
    while waiting:
        name = _plain(waiting.pop())
        if name in reached:
            continue
        reached.add(name)
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        record = distribution.read_text("RECORD") or ""
        digests[f"{name} {distribution.version}"] = record_digest(record)
        for line in distribution.requires or ():
            required, _, condition = line.partition(";")
            match = _NAME.match(required)
            if match is not None and "extra" not in condition:
                waiting.append(match[0])
    return digests


def record_digest(record: str) -> str:
    """SHA-256 over the lines of a RECORD that have a digest, without scripts and metadata, which
    differ between environments of the same versions."""
    lines = []
    for line in record.splitlines():
        path, _, rest = line.partition(",")
        elsewhere = path.startswith(("../", "/")) or ".dist-info/" in path
        if not elsewhere and not path.endswith(".pyc") and not rest.startswith(","):
            lines.append(line)
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def _changed_ns(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0


@functools.lru_cache(maxsize=64)
def _infos(folder: str, _changed_ns: int) -> tuple[str, ...]:
    kinds = ("*.dist-info", "*.egg-info") if is_site(Path(folder)) else ("*.dist-info",)
    return tuple(sorted(path.name for kind in kinds for path in Path(folder).glob(kind)))


def _lists(info: Path, top: str) -> bool:
    """Whether what ``info`` says of its files names a module or package ``top``."""
    begins = f"\n{top}".encode()
    try:
        if info.suffix == ".egg-info":  # of a system's package manager
            return begins + b"\n" in b"\n" + (info / "top_level.txt").read_bytes() + b"\n"
        record = b"\n" + (info / "RECORD").read_bytes()
    except OSError:
        return False
    return begins + b"/" in record or begins + b"." in record


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
