"""``hpc image``: images with this project, its dependencies, and nothing else. Apptainer builds one
here; for nodes that pull images, podman or Docker build one from what is written here.

The definition copies a folder of wheels and installs from it without a network, so an image built
twice from one folder holds the same versions, and a base that is a file needs no registry.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from hpc.software.container import BIN_FOLDER, MOUNT_POINTS
from hpc.software.wheels import LOCK_FILE, call, fill_wheels, own_wheel
from twin.base.errors import UsageError
from twin.base.progress import BYTES, counter

DEFINITION_FILE = "drivetwin.def"
CONTAINER_FILE = "Containerfile"
IMAGE_USER = "10001:10001"
"""User and group of an OCI image, which are nobody's."""
_OCI_NAME = re.compile(r"[a-z0-9][a-z0-9._/:@-]*")
_REFERENCE = re.compile(r"([a-z][a-z-]*)://(\S+)")
_INSTALLED = BIN_FOLDER.rpartition("/")[0]


BUBBLEWRAP = """\
    # The sandbox of stacks, for kernels that allow one in a container. Without a network the image
    # has what its base has.
    command -v bwrap >/dev/null || {
        apt="apt-get -o APT::Sandbox::User=root -o Acquire::Retries=0 -o Acquire::http::Timeout=10"
        $apt update && $apt install --yes --no-install-recommends bubblewrap \\
            && rm -rf /var/lib/apt/lists/*
    } || echo "no bubblewrap: stacks have no sandbox in this image; take a --base with it" >&2
"""
"""Lines of ``%post`` that install it."""


def default_base() -> str:
    """The official image of this machine's Python version: the wheels are made for that one."""
    return f"docker://python:{sys.version_info[0]}.{sys.version_info[1]}-slim"


def definition(base: str) -> str:
    """The Apptainer definition; its folder must hold ``wheels/`` and the lock file. Pure.

    Args:
        base: ``docker://NAME``, another reference that Apptainer knows, or the absolute path of an
            image or a folder. It must hold Python with ``venv``.

    Raises:
        UsageError: the base cannot be used.
    """
    match = _REFERENCE.fullmatch(base)
    if match:
        agent, name = match[1], match[2]
    elif base.startswith("/") and not re.search(r"\s", base):
        agent, name = "localimage", base
    else:
        raise UsageError(
            f"--base {base!r}: give a reference such as {default_base()}, or the path of an image "
            "or folder, without white space"
        )
    return f"""\
# An Apptainer definition, written by `hpc image build`. To build it by hand, put the wheels of
# `hpc bundle` into wheels/ beside it: apptainer build drivetwin.sif {DEFINITION_FILE}
Bootstrap: {agent}
From: {name}

%files
    wheels {_INSTALLED}-wheels
    {LOCK_FILE} {_INSTALLED}-{LOCK_FILE}

%post
    set -eu
    # Without a network: everything is in the wheels.
    python3 -m venv {_INSTALLED}
    {BIN_FOLDER}/python -m pip install --no-index --no-cache-dir --disable-pip-version-check \\
        --find-links={_INSTALLED}-wheels --constraint={_INSTALLED}-{LOCK_FILE} drivetwin
    rm -r {_INSTALLED}-wheels {_INSTALLED}-{LOCK_FILE}
    # Places for the file systems of clusters; not every runtime can make them.
    mkdir -p {" ".join(MOUNT_POINTS)}
    chmod -R a+rX {_INSTALLED}
{BUBBLEWRAP}
%environment
    export PATH={BIN_FOLDER}:$PATH
    export PYTHONNOUSERSITE=1

%runscript
    exec "$@"

%test
    {BIN_FOLDER}/conductor --version
    {BIN_FOLDER}/twin --version
"""


def containerfile(base: str, extras: Sequence[str] = ()) -> str:
    """What an OCI image is built from, with ``wheels/`` and the lock file beside it. Pure.

    Args:
        base: name of an image with Python and ``venv``, e.g. ``python:3.11-slim``.
        extras: extras of the project that are installed, too.

    Raises:
        UsageError: the base cannot be used.
    """
    project = f"'drivetwin[{','.join(extras)}]'" if extras else "drivetwin"
    name = base.removeprefix("docker://")
    if not _OCI_NAME.fullmatch(name):
        raise UsageError(
            f"--base {base!r}: give the name of an image, e.g. "
            f"{default_base().removeprefix('docker://')}"
        )
    return f"""\
# Written by `hpc image context`: podman build --tag NAME FOLDER, or docker build.
FROM {name}
RUN --mount=type=bind,source=wheels,target=/wheels \\
    --mount=type=bind,source={LOCK_FILE},target=/{LOCK_FILE} \\
    python3 -m venv {_INSTALLED} \\
    && {BIN_FOLDER}/python -m pip install --no-index --no-cache-dir --disable-pip-version-check \\
        --find-links=/wheels --constraint=/{LOCK_FILE} {project} \\
    && chmod -R a+rX {_INSTALLED} \\
    && {BIN_FOLDER}/conductor --version
ENV PATH={BIN_FOLDER}:$PATH PYTHONNOUSERSITE=1
USER {IMAGE_USER}
"""


def write_context(
    source: Path, out: Path, base: str, wheels: Path | None, extras: Sequence[str] = ()
) -> None:
    """Write the folder from which an OCI image is built.

    Args:
        source: the project's checkout.
        out: a new folder; complete or absent, also when this is killed.
        base: see :func:`containerfile`.
        wheels: folder of wheels, which are copied; None: they are built and downloaded.
        extras: extras of the project that are installed, too; given wheels must have theirs.

    Raises:
        UsageError: ``out`` exists, or the base or the wheels cannot be used.
        InfrastructureError: pip failed.
    """
    text = containerfile(base, extras)
    out = _new(out, wheels)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as name:
        folder = Path(name) / out.name
        folder.mkdir()
        (folder / CONTAINER_FILE).write_text(text)
        _add_software(source, folder, wheels, _copy, extras)
        folder.rename(out)


def build(source: Path, out: Path, base: str, wheels: Path | None) -> None:
    """Build the image ``out``: a SIF file if it ends in ``.sif``, else a folder.

    Args:
        source: the project's checkout.
        out: complete or absent, also when the build is killed.
        base: see :func:`definition`.
        wheels: folder of wheels; None: they are built and downloaded.

    Raises:
        UsageError: ``out`` exists, or the base or the wheels cannot be used.
        InfrastructureError: pip or Apptainer failed.
    """
    text = definition(base)
    out = _new(out, wheels)
    # Beside the image: the temporary folder of a login node is seldom large enough.
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as name:
        folder = Path(name)
        (folder / DEFINITION_FILE).write_text(text)
        _add_software(source, folder, wheels, os.symlink)
        made = folder / out.name
        more = counter("images", 1)
        scratch = {"APPTAINER_TMPDIR": name, "APPTAINER_CACHEDIR": f"{name}/cache"}
        kind = [] if out.suffix == ".sif" else ["--sandbox"]
        call(
            ["apptainer", "build", *kind, str(made), DEFINITION_FILE],
            "apptainer build",
            folder=folder,
            environment={**scratch, **os.environ},
        )
        more(1)
        made.rename(out)


def _new(out: Path, wheels: Path | None) -> Path:
    """``out`` as an absolute path, in a folder that is there.

    Raises:
        UsageError: it exists, or the wheels cannot be used.
    """
    out = out.absolute()
    if out.exists():
        raise UsageError(f"{out}: exists already; remove it or choose another --out")
    if wheels is not None:
        own_wheel(wheels)
    out.parent.mkdir(parents=True, exist_ok=True)
    return out


def _add_software(
    source: Path,
    folder: Path,
    wheels: Path | None,
    bring: Callable[[Path, Path], object],
    extras: Sequence[str] = (),
) -> None:
    """The lock file and ``wheels/``, in ``folder``; wheels that are given come by ``bring``."""
    shutil.copy(source / LOCK_FILE, folder)
    if wheels is not None:
        bring(wheels.absolute(), folder / "wheels")
        return
    (folder / "wheels").mkdir()
    fill_wheels(source, folder / "wheels", extras)


def _copy(source: Path, target: Path) -> None:
    """Copy a folder, counted by the bytes of its files."""
    more = counter(BYTES, sum(p.stat().st_size for p in source.rglob("*") if p.is_file()))

    def copied(one: str, other: str) -> str:
        shutil.copy2(one, other)
        more(Path(other).stat().st_size)
        return other

    shutil.copytree(source, target, copy_function=copied)
