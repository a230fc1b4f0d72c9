"""A folder of wheels: this project's own and everything that it needs, as the lock file pins it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from twin.base.errors import InfrastructureError, UsageError
from twin.base.progress import counter

LOCK_FILE = "constraints.txt"
DISTRIBUTION = "drivetwin"


def source_folder(given: Path | None = None) -> Path:
    """The project's checkout: the one that this command runs from unless another is ``given``.

    Raises:
        UsageError: it is none.
    """
    folder = (given or Path(__file__).parents[2]).absolute()
    missing = [name for name in ("pyproject.toml", LOCK_FILE) if not (folder / name).is_file()]
    if missing:
        raise UsageError(
            f"{folder}: no {' and '.join(missing)} there; give the project's checkout with --source"
        )
    return folder


def checked_extras(source: Path, named: Sequence[str]) -> tuple[str, ...]:
    """Extras of the project's checkout, each once.

    Raises:
        UsageError: it has no such extra.
    """
    declared = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))
    known = sorted(declared.get("project", {}).get("optional-dependencies", {}))
    for name in named:
        if name not in known:
            raise UsageError(f"--extra {name[:80]!r}: the project has {', '.join(known) or 'none'}")
    return tuple(sorted({*named}))


def fill_wheels(source: Path, folder: Path, extras: Sequence[str] = ()) -> None:
    """Build the project's wheel and download what it and its ``extras`` need into ``folder``, which
    must exist.

    The wheels suit machines with this machine's Python version and architecture.

    Raises:
        InfrastructureError: pip failed; its words stand on stderr.
    """
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    more = counter("pip runs", 2)
    call([*pip, "wheel", "--no-deps", "--wheel-dir", str(folder), str(source)], "pip wheel")
    more(1)
    lock = str(source / LOCK_FILE)
    download = [*pip, "download", "--only-binary", ":all:", "--constraint", lock]
    wanted = f"{own_wheel(folder)}[{','.join(extras)}]" if extras else str(own_wheel(folder))
    call([*download, "--dest", str(folder), wanted], "pip download")
    more(1)


def own_wheel(folder: Path) -> Path:
    """The project's wheel in a folder of wheels.

    Raises:
        UsageError: none, or several.
    """
    wheels = sorted(folder.glob(f"{DISTRIBUTION}-*.whl"))
    if len(wheels) != 1:
        names = ", ".join(path.name for path in wheels) or "none"
        raise UsageError(
            f"{folder}: one wheel {DISTRIBUTION}-*.whl is needed, found {names}; "
            "`hpc bundle` writes such a folder"
        )
    return wheels[0]


def call(
    words: Sequence[str],
    what: str,
    *,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    allowed: Sequence[int] = (0,),
) -> None:
    """Run a tool to its end; what it says goes to stderr.

    Args:
        words: command line.
        what: names it in an error.
        folder: working folder.
        environment: its whole environment; None: ours.
        allowed: exit codes that are no failure.

    Raises:
        InfrastructureError: it is not there, or it failed.
    """
    try:
        code = subprocess.run(
            list(words),
            stdin=subprocess.DEVNULL,
            stdout=sys.stderr.fileno(),
            cwd=folder,
            env=environment,
            check=False,
        ).returncode
    except FileNotFoundError:
        raise InfrastructureError(
            f"{what}: no command {words[0]} on this machine; load its module or install it"
        ) from None
    if code not in allowed:
        raise InfrastructureError(f"{what} failed with exit code {code}; see above what it said")
