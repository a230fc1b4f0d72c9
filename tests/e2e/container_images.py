"""Images for tests of containers, and an ordinary user to run them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

from hpc.software.container import Container, prefix, preparation

NOBODY = 65534
"""User and group of somebody who owns nothing."""


def shell_image(folder: Path) -> Path:
    """An image that holds nothing: the places for the host's system and for this Python.

    It takes no time to make and runs the code under test with the libraries of the host, so it
    proves how a container is entered, not what is in an image.
    """
    for name in ("dev", "etc", "home", "proc", "root", "sys", "tmp", "usr", "var"):
        (folder / name).mkdir(parents=True)
    for name in ("passwd", "group", "hosts", "resolv.conf", "hostname", "localtime"):
        (folder / "etc" / name).touch()
    for name in ("bin", "lib", "lib64", "sbin"):
        if Path("/", name).is_symlink():
            (folder / name).symlink_to(f"usr/{name}")
    return folder


def missing(*commands: str) -> str:
    """Why these commands cannot be tested; empty: they can."""
    absent = [command for command in commands if shutil.which(command) is None]
    if not absent:
        return ""
    return (
        f"no command {', '.join(absent)}; Debian packages charliecloud and mmdebstrap, for "
        "apptainer tests/e2e/install_apptainer.sh"
    )


def prepared(
    container: Container, user: tuple[str, ...] = (), variables: dict[str, str] | None = None
) -> tuple[str, ...]:
    """Words before a command, once the image is ready."""
    for words in preparation(container):
        subprocess.run([*user, *words], env=variables, check=True)
    return tuple(prefix(container))


def python_folders() -> tuple[str, ...]:
    """What an empty image needs to run this Python: the system, the interpreter, its packages."""
    found = {"/usr", sys.prefix, sys.base_prefix, *_search_path()}
    return tuple(sorted(os.path.realpath(path) for path in found))


def _search_path() -> list[str]:
    return [path for path in sys.path if Path(path).is_dir()]


def ordinary_user(folder: Path) -> tuple[tuple[str, ...], dict[str, str]]:
    """Words before a command, and variables, that make somebody without rights run it.

    Args:
        folder: becomes that user's home.
    """
    variables = {**os.environ, "HOME": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    variables["DRIVETWIN_HOME"] = str(folder / "own")  # that of the tests is root's
    if os.getuid():
        return (), variables
    os.chown(folder, NOBODY, NOBODY)
    ids = ("--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups")
    return ("setpriv", *ids), {**variables, "USER": "nobody", "LOGNAME": "nobody"}


def ordinary_python(user: tuple[str, ...], variables: dict[str, str]) -> list[str]:
    """A Python of this version that the user may run, with this project on its path; or nothing."""
    path = os.pathsep.join(_search_path())
    system = shutil.which(f"python3.{sys.version_info[1]}", path="/usr/bin") or ""
    for python in (sys.executable, system):
        words = ["env", f"PYTHONPATH={path}", python]
        done = subprocess.run(
            [*user, *words, "-c", "import hpc, typer, msgspec"],
            env=variables,
            capture_output=True,
            check=False,
        )
        if done.returncode == 0:
            return words
    return []


def debian_base(folder: Path, user: tuple[str, ...], variables: dict[str, str]) -> Path:
    """A small Debian of this release with Python, owned by the user; from the Debian mirror."""
    release = dict(
        line.split("=", 1) for line in Path("/etc/os-release").read_text().split() if "=" in line
    )["VERSION_CODENAME"]
    archive = folder / "base.tar"
    subprocess.run(
        [
            *("mmdebstrap", "--quiet", "--variant=apt"),
            *("--include=python3,python3-venv,ca-certificates", release, str(archive)),
        ],
        check=True,
    )
    with tarfile.open(archive) as tar:
        # Devices are root's; the runtimes bring their own.
        names = [member.name for member in tar if member.ischr() or member.isblk()]
    base = folder / "base"
    subprocess.run([*user, "mkdir", str(base)], env=variables, check=True)
    subprocess.run(
        [
            *(*user, "tar", "-x", "--no-same-owner", "-C", str(base), "-f", str(archive)),
            *(f"--exclude={name}" for name in names),
        ],
        env=variables,
        check=True,
    )
    archive.unlink()
    return base
