"""What a campaign names but does not hold: repositories and images, fetched before submission.

Compute nodes have no internet, so this runs on the login node and leaves a cache on the shared file
system::

    CACHE/repositories/<key>/tree/      the files, read-only; beside them input.json: their origin
    CACHE/images/<sha256>.sif           an image, read-only
    CACHE/repositories/<key>.log        what a set-up command said that failed
    CACHE/mirrors/<url's digest>.git    bare clones; a commit they hold needs no network again

A key is the digest of the content (git's tree id) and of the set-up command, so a branch that moved
gives another folder and an entry never changes. Entries appear by a rename: they are complete or
absent. Two fetches of one entry wait for each other where the file system knows locks; where it
does not, both do the work and the second rename loses, which is as good.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import hashlib
import json
import os
import re
import secrets
import shutil
import signal
import stat
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from schemas.digest import digest
from schemas.sections.foreign import PASSWORD, holds_password
from twin.base.cache import check_cache
from twin.base.errors import InfrastructureError, UsageError, storage_error
from twin.base.files import write_atomic

TIMEOUT_S = 1800.0
"""Longest a transfer or a set-up command may take [s]."""

OUTPUT_BYTES_MAX = 1 << 20
"""Most output of a set-up command, and most errors, that are kept, from their end [bytes]."""

LINES = 5
"""Lines of a failed set-up command in its error; more of them are in its log."""

_PR_SET_PDEATHSIG = 1

_COMMIT = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")
_REFERENCE = re.compile(r"(docker|oras|library|https?)://\S+")


@dataclass(frozen=True, slots=True)
class NamedRepository:
    """A repository as a campaign names it.

    Raises:
        UsageError: a value cannot be used.
    """

    url: str
    """What ``git clone`` takes: a URL or the path of a clone, bare or not."""
    ref: str
    """Branch, tag or commit."""
    setup: str = ""
    """Shell command that is run in the files once, e.g. ``pip install --target deps .``."""

    def __post_init__(self) -> None:
        if holds_password(self.url):
            raise UsageError(f"repository url: {PASSWORD}")
        for name, value in (("url", self.url), ("ref", self.ref)):
            if not value or value.startswith("-") or re.search(r"[\x00-\x20\x7f]", value):
                raise UsageError(
                    f"repository {name} {value!r}: give one without spaces and leading '-'"
                )


@dataclass(frozen=True, slots=True)
class FetchedRepository:
    """A repository in the cache."""

    folder: Path
    """Folder of its files, read-only."""
    commit: str
    key: str
    """Digest of content and set-up."""


def fetch_repository(repository: NamedRepository, cache: Path) -> FetchedRepository:
    """The files of ``repository`` in the cache, fetched unless they are there.

    Raises:
        UsageError: no such repository or ref, the set-up failed, or the cache cannot be written.
        InfrastructureError: git is missing, or the disk lets us down.
    """
    if shutil.which("git") is None:
        raise InfrastructureError("no command git on this machine; load its module or install it")
    cache = cache.absolute()
    with _storage(cache):
        mirrors = _own(cache, "mirrors")
        name = hashlib.sha256(repository.url.encode()).hexdigest()[:16]
        mirror = mirrors / f"{name}.git"
        with _locked(mirrors / f"{name}.lock") as alone:
            commit = _commit(repository, mirror, alone)
        tree = _git("--git-dir", str(mirror), "rev-parse", f"{commit}^{{tree}}")
        key = digest([tree.encode(), repository.setup.encode()])
        entry = _own(cache, "repositories") / key
        with _locked(entry.parent / f"{key}.lock") as alone:
            if not entry.exists():
                _make(repository, mirror, commit, entry, alone)
    return FetchedRepository(entry / "tree", commit, key)


def fetch_image(source: str, cache: Path, *, refresh: bool = False) -> Path:
    """The image ``source`` in the cache: a file's copy, or a reference pulled by Apptainer.

    Args:
        source: path, or ``docker://NAME`` and the like.
        cache: cache folder.
        refresh: pull a reference again, though it is known; names may mean other images later.

    Raises:
        UsageError: no such image, or the cache cannot be written.
        InfrastructureError: Apptainer is missing or failed, or the disk lets us down.
    """
    cache = cache.absolute()
    with _storage(cache):
        images = _own(cache, "images")
        name = hashlib.sha256(source.encode()).hexdigest()[:16]
        with _locked(images / f"{name}.lock") as alone:
            if not _REFERENCE.fullmatch(source):
                return _copied(source, images, name, alone)
            pointer = images / f"{name}.json"
            if pointer.exists() and not refresh:
                known = images / str(json.loads(pointer.read_bytes())["file"])
                if known.exists():
                    return known
            with _scratch(images, name, alone) as folder:
                _run(["apptainer", "pull", "image.sif", source], f"image {source}", folder)
                kept = _keep(folder / "image.sif", images)
            write_atomic(pointer, json.dumps({"source": source, "file": kept.name}).encode())
            return kept


def _own(cache: Path, name: str) -> Path:
    """A folder of the cache, which nobody else may write; made if it is missing."""
    check_cache(cache)
    for folder in (*reversed(cache.parents), cache, cache / name):
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o755)
            folder.chmod(0o755)  # also where a group may write to what its members make
    check_cache(cache)  # somebody may have been first
    return cache / name


def _copied(source: str, images: Path, name: str, alone: bool) -> Path:
    if not Path(source).is_file():
        raise UsageError(f"image {source!r}: no such file; give a path or docker://NAME[:TAG]")
    with _scratch(images, name, alone) as folder:
        return _keep(Path(shutil.copyfile(source, folder / "image.sif")), images)


def _commit(repository: NamedRepository, mirror: Path, alone: bool) -> str:
    """The commit that ``ref`` means now; the mirror holds it afterwards."""
    url, ref = repository.url, repository.ref
    # A full commit id never means anything else: no network is needed to know it.
    if mirror.exists() and _COMMIT.fullmatch(ref) and (commit := _resolved(mirror, ref)):
        return commit
    what = f"repository {url}"
    if mirror.exists():
        _run(["git", "fetch", "--quiet", "--prune", "--force", url, "+refs/*:refs/*"], what, mirror)
    else:
        with _scratch(mirror.parent, mirror.stem, alone) as folder:
            _run(["git", "clone", "--quiet", "--mirror", "--", url, "new.git"], what, folder)
            (folder / "new.git").rename(mirror)
    if commit := _resolved(mirror, ref):
        return commit
    names = _git("--git-dir", str(mirror), "for-each-ref", "--format=%(refname:short)", "--count=9")
    raise UsageError(
        f"repository {url}: no branch, tag or commit {ref!r}; there are "
        + (", ".join(names.split()) or "none at all")
    )


def _resolved(mirror: Path, ref: str) -> str:
    """The commit of ``ref`` in the mirror, or nothing."""
    try:
        return _git(
            "--git-dir", str(mirror), "rev-parse", "--verify", "--quiet", f"{ref}^{{commit}}"
        )
    except subprocess.CalledProcessError:
        return ""


def _make(repository: NamedRepository, mirror: Path, commit: str, entry: Path, alone: bool) -> None:
    what = f"repository {repository.url}"
    with _scratch(entry.parent, entry.name, alone) as folder:
        tree = folder / "tree"
        _run(["git", "clone", "--quiet", "--no-checkout", "--", str(mirror), "tree"], what, folder)
        # Submodules with relative addresses are meant relative to the real repository.
        _run(["git", "remote", "set-url", "origin", repository.url], what, tree)
        _run(["git", "checkout", "--quiet", "--detach", commit], what, tree)
        if (tree / ".gitmodules").exists():
            _run(["git", "submodule", "--quiet", "update", "--init", "--recursive"], what, tree)
        if repository.setup:
            log = entry.parent / f"{entry.name}.log"
            _run(["sh", "-c", repository.setup], f"{what}: setup {repository.setup!r}", tree, log)
        shutil.rmtree(tree / ".git")
        facts = {**asdict(repository), "commit": commit, "key": entry.name}
        write_atomic(folder / "input.json", json.dumps(facts, indent=1).encode() + b"\n")
        _close(tree)
        folder.chmod(0o755)
        try:
            folder.rename(entry)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
            # Somebody else was first, on a file system without locks.


def _keep(image: Path, images: Path) -> Path:
    """Move a finished image to the name of its content."""
    with image.open("rb") as file:
        kept = images / f"{hashlib.file_digest(file, 'sha256').hexdigest()}.sif"
    image.chmod(0o444)
    image.rename(kept)
    return kept


def _close(tree: Path) -> None:
    """Nobody writes here any more, by mistake."""
    for folder, _, files in os.walk(tree):
        for path in (Path(folder), *(Path(folder, name) for name in files)):
            if not path.is_symlink():
                path.chmod(stat.S_IMODE(path.stat().st_mode) & ~0o222)


def _git(*arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL
    )
    return done.stdout.strip()


def _run(words: Sequence[str], what: str, folder: Path, log: Path | None = None) -> None:
    """Run a command; a failure is one line with its last words, more of them are in ``log``."""
    # Nobody is there to be asked for a password.
    variables = {**os.environ, "GIT_TERMINAL_PROMPT": "0"}
    try:
        done = (_fetched if log is None else _set_up)(list(words), folder, variables)
    except FileNotFoundError:
        raise InfrastructureError(
            f"{what}: no command {words[0]} on this machine; load its module or install it"
        ) from None
    except subprocess.TimeoutExpired:
        raise InfrastructureError(f"{what}: not done after {TIMEOUT_S:.0f} s") from None
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        ended = f"{what}: {lines[-1] if lines else f'exit code {done.returncode}'}"
        if log is None:
            raise UsageError(ended)
        log.write_text(f"$ {words[-1]}\n{done.stdout}{done.stderr}exit code {done.returncode}\n")
        last = " | ".join(line.strip() for line in lines[-LINES:])
        raise UsageError(f"{what}: exit code {done.returncode}: {last}; what it said is in {log}")


def _fetched(
    words: list[str], folder: Path, variables: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run a tool that we know."""
    return subprocess.run(
        words,
        cwd=folder,
        env=variables,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=TIMEOUT_S,
        check=False,
    )


def _set_up(
    words: list[str], folder: Path, variables: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run somebody's command; what it started ends with it, in time, and with Ctrl-C.

    Its output goes to files: nothing waits for a process that it left behind with a pipe.
    """
    libc = ctypes.CDLL(None)
    bind = libc.prctl  # looked up here: between fork and exec no lock may be asked for
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen(
            words,
            cwd=folder,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
            preexec_fn=lambda: bind(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0),
        )
        try:
            code = child.wait(TIMEOUT_S)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        return subprocess.CompletedProcess(words, code, _tail(out), _tail(err))


def _tail(file: IO[bytes]) -> str:
    """Last bytes of a program's output."""
    file.seek(max(0, file.seek(0, os.SEEK_END) - OUTPUT_BYTES_MAX))
    return file.read().decode("utf-8", "replace")


@contextlib.contextmanager
def _scratch(folder: Path, name: str, alone: bool) -> Iterator[Path]:
    """A new folder beside the entries, removed unless it became one.

    Whoever works ``alone`` on ``name`` removes what a fetch that was killed left of it.
    """
    if alone:
        for left in folder.glob(f".{name}.*.partial"):
            _remove(left)
    made = folder / f".{name}.{secrets.token_hex(4)}.partial"
    made.mkdir(mode=0o700)
    try:
        yield made
    finally:
        if made.exists():
            _remove(made)


def _remove(folder: Path) -> None:
    _open(folder)  # else nothing can be removed from it
    for name, folders, _ in os.walk(folder):
        for below in folders:  # before they are looked into: a set-up may have taken all rights
            _open(Path(name) / below)
    shutil.rmtree(folder, ignore_errors=True)


def _open(folder: Path) -> None:
    if not folder.is_symlink():
        with contextlib.suppress(OSError):  # somebody else may remove it as well
            folder.chmod(0o700)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Hold the lock file ``path``; False: the file system knows no locks."""
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
                raise
            yield False
        else:
            yield True


@contextlib.contextmanager
def _storage(cache: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise storage_error(error, f"cache {error.filename or cache}") from None
