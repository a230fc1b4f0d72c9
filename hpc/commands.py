"""Runs other programs: the only module here that does."""

from __future__ import annotations

import contextlib
import os
import select
import selectors
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from schemas.escape import escape
from twin.base.errors import InfrastructureError

OUTPUT_BYTES_MAX = 1 << 26
"""Most that a program may say on each of its outputs [bytes]; a campaign of a million cases has
their ids in a third of it."""
WORDS_CHARS_MAX = 500
"""Longest line of a program that is told [characters]."""
TIMEOUT_S = 120.0
"""Longest wait for a program; a busy scheduler and a cold shared file system are slow [s]."""


@dataclass(frozen=True, slots=True)
class ProgramEnd:
    """End of a program: its exit code and what it wrote."""

    code: int
    out: str
    err: str

    @property
    def last_words(self) -> str:
        """The line that says most about a failure: the last one on standard error, escaped."""
        lines = [line for line in (self.err or self.out).splitlines() if line.strip()]
        return escape(lines[-1].strip(), WORDS_CHARS_MAX) if lines else f"exit code {self.code}"


class UnknownOutcomeError(InfrastructureError):
    """Nobody knows whether a submission was taken."""


@dataclass(frozen=True, slots=True)
class Place:
    """Host on which programs are run: a login node of another cluster, say."""

    reach: tuple[str, ...] = ()
    """Words before one line of shell, e.g. ``ssh me@login``; empty: this host."""
    once: str = ""
    """Folder there in which ``submits`` is run once and for all: asked again, it gives the answer
    of the first time. Empty: nothing is kept."""
    submits: str = ""
    """The program that is run once."""
    kubeconfig: str = ""
    """File that says which Kubernetes is meant; empty: the user's own."""


HERE = Place()
_PLACE: ContextVar[Place] = ContextVar("place", default=HERE)


@contextlib.contextmanager
def at(place: Place) -> Iterator[None]:
    """Run programs at ``place`` while the block lasts, whoever asks for them."""
    token = _PLACE.set(place)
    try:
        yield
    finally:
        _PLACE.reset(token)


def place() -> Place:
    """Where programs are run now."""
    return _PLACE.get()


_ONCE = """\
cd {folder} || exit 71
if mkdir .submitting 2>/dev/null; then
  {{ {line}; }} > .said 2> .trouble < /dev/null
  echo $? > .code.tmp && mv .code.tmp .code
fi
i=0
until [ -e .code ]; do
  i=$((i + 1))
  [ $i -lt {tries} ] || {{ echo {cut_off} >&2; exit {unknown}; }}
  sleep 0.1
done
cat .said; cat .trouble >&2; code=$(cat .code)
[ "$code" != {unreached} ] || code=1
exit "$code"
"""
_NEVER = """\
umask 077; mkdir -p "$0" && cd "$0" || exit 71
mkdir .submitting 2>/dev/null || exit 1
: > .said; echo "it was ended before it was submitted" > .trouble
echo 1 > .code.tmp && mv .code.tmp .code
"""
UNREACHED = 255
"""Exit code of ``ssh`` that did not get there."""
CODE_UNKNOWN = 70
"""Exit code of a submission of which nobody knows whether it was taken: its host died in it."""
ONCE_TRIES = 300
"""How often the answer of another submission of the same is looked for, every 0.1 s."""


def exists(program: str) -> bool:
    """Whether the program is on the PATH."""
    if place().reach:
        return not call("sh", "-c", 'command -v "$0" >/dev/null', program).code
    return shutil.which(program) is not None


def write_there(path: str, data: bytes, mode: int) -> None:
    """Write a file at the current place, complete or not at all; folders above it are made, for
    their user alone. Its content is in no command line.

    Raises:
        InfrastructureError: it cannot be written.
    """
    script = (
        'umask 077; mkdir -p "$(dirname "$0")" && cat > "$0.tmp" && chmod "$1" "$0.tmp" '
        '&& mv "$0.tmp" "$0"'
    )
    done = call("sh", "-c", script, path, f"{mode:o}", text=data.decode())
    if done.code:
        raise InfrastructureError(f"{path}: cannot be written there: {done.last_words}")


def is_answered(folder: str) -> bool:
    """Whether the submission of this folder at the current place has an answer, which is kept.

    Raises:
        InfrastructureError: the place does not answer.
    """
    return call("test", "-e", f"{folder}/.code").code == 0


def refuse_submission(folder: str) -> bool:
    """See to it that nothing is ever submitted in this folder at the current place; False:
    something was already.

    Raises:
        InfrastructureError: the place does not answer.
    """
    done = call("sh", "-c", _NEVER, folder)
    if done.code not in (0, 1):
        raise InfrastructureError(f"{folder}: cannot be used there: {done.last_words}")
    return done.code == 0


def call(
    *arguments: str, text: str | None = None, folder: Path | None = None, wait_s: float = TIMEOUT_S
) -> ProgramEnd:
    """Run a program to its end, with ``text`` on its standard input.

    At another :class:`Place` the folder is one over there.

    Raises:
        InfrastructureError: it is not there, or does not answer.
    """
    words, apart = _words(arguments, folder)
    try:
        with subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=None if apart else folder,
            # A submission goes on when whoever asked for it is stopped, and its answer is kept.
            start_new_session=apart,
        ) as child:
            try:
                code, out, err = _heard(child, (text or "").encode(), wait_s)
            except BaseException:
                child.kill()
                raise
    except _TooMuchError:
        raise InfrastructureError(
            f"`{arguments[0]}` says more than {OUTPUT_BYTES_MAX} bytes; ask the site"
        ) from None
    except subprocess.TimeoutExpired:
        raise InfrastructureError(
            f"`{arguments[0]}` did not answer in {wait_s:.0f} s; try again, or ask the site"
        ) from None
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None
    here = place()
    if here.reach and code == UNREACHED:
        said = ProgramEnd(1, "", err).last_words
        raise InfrastructureError(f"{escape(here.reach[-1])}: not reached: {said}")
    if here.once and code == CODE_UNKNOWN and arguments[0] == here.submits:
        raise UnknownOutcomeError(
            "whether the job was taken is not known: its host was lost while it was submitted"
        )
    return ProgramEnd(code, out, err)


class _TooMuchError(Exception):
    """A program has said more than it may."""


def _heard(child: subprocess.Popen[bytes], text: bytes, wait_s: float) -> tuple[int, str, str]:
    """Exit code and outputs of a program that gets ``text``.

    Raises:
        _TooMuchError: it says too much.
        subprocess.TimeoutExpired: it does not end, or does not let go of its outputs.
    """
    assert child.stdin is not None
    until_s = time.monotonic() + wait_s
    outputs = {child.stdout: bytearray(), child.stderr: bytearray()}
    left = memoryview(text)
    with selectors.DefaultSelector() as selector:
        for stream in outputs:
            assert stream is not None
            selector.register(stream, selectors.EVENT_READ)
        if left:
            selector.register(child.stdin, selectors.EVENT_WRITE)
        else:
            child.stdin.close()
        while selector.get_map():
            if (rest_s := until_s - time.monotonic()) <= 0:
                raise subprocess.TimeoutExpired(child.args, wait_s)
            for key, _ in selector.select(rest_s):
                if key.fileobj is child.stdin:
                    left = _written(key.fd, left)
                    if not left:
                        selector.unregister(child.stdin)
                        with contextlib.suppress(BrokenPipeError):
                            child.stdin.close()
                    continue
                data = os.read(key.fd, 1 << 16)
                found = outputs[key.fileobj]  # type: ignore[index]  # a stream of ours
                found += data
                if len(found) > OUTPUT_BYTES_MAX:
                    raise _TooMuchError
                if not data:
                    selector.unregister(key.fileobj)
    code = child.wait(max(0.0, until_s - time.monotonic()))
    out, err = (bytes(found).decode("utf-8", "replace") for found in outputs.values())
    return code, out, err


def _written(descriptor: int, left: memoryview) -> memoryview:
    """What is left to write; nothing if nobody reads it any more."""
    try:
        return left[os.write(descriptor, left[: select.PIPE_BUF]) :]
    except BrokenPipeError:
        return left[:0]


def _words(arguments: tuple[str, ...], folder: Path | None) -> tuple[tuple[str, ...], bool]:
    """What is run in place of ``arguments``, and whether it finds its folder by itself."""
    here = place()
    once = bool(here.once) and arguments[0] == here.submits
    if not here.reach and not once:
        return arguments, False
    line = shlex.join(arguments)
    if folder is not None:
        line = f"cd {shlex.quote(str(folder))} && {line}"
    if once:
        line = _ONCE.format(
            folder=shlex.quote(here.once),
            line=line,
            tries=ONCE_TRIES,
            cut_off=shlex.quote("its host was lost while it was submitted"),
            unknown=CODE_UNKNOWN,
            unreached=UNREACHED,
        )
    return (*here.reach, f"sh -c {shlex.quote(line)}") if here.reach else ("sh", "-c", line), True


def start_apart(*arguments: str, log: Path) -> subprocess.Popen[bytes]:
    """Start a program that goes on when this one has ended; what it says is added to ``log``.

    Raises:
        InfrastructureError: it cannot be started.
    """
    try:
        with log.open("ab") as file:
            return subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None


def watch(*arguments: str) -> int:
    """Run a program that talks to the user itself; its exit code.

    Raises:
        InfrastructureError: it is not there.
    """
    try:
        return subprocess.run(arguments, check=False).returncode
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None


def become(*arguments: str) -> None:
    """Replace this process.

    Raises:
        InfrastructureError: the program is not there.
    """
    try:
        os.execvp(arguments[0], arguments)
    except OSError as error:
        raise InfrastructureError(f"`{arguments[0]}` cannot be run: {error.strerror}") from None
