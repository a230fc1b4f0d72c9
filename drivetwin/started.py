"""A run in the background: a thread that does what `conductor run` does, and who listens to it."""

from __future__ import annotations

import atexit
import contextlib
import signal
import sys
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from conductor.run.listener import RunProgress
from drivetwin.finished import Run
from twin.base.errors import TwinError, UnfinishedError, UsageError

if TYPE_CHECKING:
    from conductor.run.requested import RunRequest

EVENTS_MAX = 10_000
"""Events that are kept for those who listen; whoever is slower misses the oldest."""
STOP_S = 30.0
"""How long the end of this process waits for a run that was started and not waited for [s]."""

_under_way = threading.Lock()
"""Held by the run of this process: what it tells its children is in this process's environment."""
_what: list[str] = []
"""Campaign of that run."""


@dataclass(frozen=True, slots=True)
class EventLine:
    """A line that a run says to people."""

    text: str


RunEvent = EventLine | RunProgress
"""What happens in a run: a line, or ``cases``, ``ended``, ``passed`` and ``running``."""


class StartedRun:
    """A run that was started; wait for it by :meth:`wait`, or await it."""

    def __init__(self, request: RunRequest) -> None:
        from conductor.run.stopping import Signals

        if not _under_way.acquire(blocking=False):
            raise UsageError(
                f"{request.campaign}: this process runs {' '.join(_what)}; wait for it, or stop it"
            )
        _what[:] = [request.campaign]
        self._request = request
        self._signals = Signals()
        self._events = _Events()
        self._folder: Path | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="drivetwin run", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:
            _under_way.release()
            raise
        atexit.register(self._leave)

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._thread.is_alive()

    def wait(self, *, progress: bool = True) -> Run:
        """Wait for its end.

        Args:
            progress: show a bar in a terminal and in a notebook, lines elsewhere.

        Raises:
            UsageError: it cannot be run as asked; a line per mistake.
            InfrastructureError: disk, network or processes let us down; the same call goes on.
            UnfinishedError: it was stopped.
            KeyboardInterrupt: it was interrupted; workers have ended, the same call goes on.
        """
        try:
            with _shown(progress) as show:
                for event in self.events():
                    show(event)
        except BaseException as error:
            self.stop()
            self._over()
            if progress and isinstance(error, KeyboardInterrupt):
                print("interrupted; the same call goes on", file=sys.stderr)
            raise
        return self._result()

    def stop(self) -> None:
        """Ask it to stop: workers give their cases back; the same call goes on later."""
        self._signals.ask(signal.SIGTERM)

    def events(self) -> Iterator[RunEvent]:
        """What happens from the start on, until its end."""
        place = 0
        while True:
            found, place = self._events.since(place)
            yield from found
            if place < 0:
                self._thread.join()
                return

    async def aevents(self) -> AsyncIterator[RunEvent]:
        """Events for an event loop, as :meth:`events`: ``async for event in run.aevents()``."""
        import asyncio

        loop, changed, place = asyncio.get_running_loop(), asyncio.Event(), 0

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(changed.set)

        with self._events.waking(wake):
            while True:
                changed.clear()
                found, place = self._events.since(place, wait=False)
                for event in found:
                    yield event
                if place < 0:
                    return
                if not found:
                    await changed.wait()

    def __await__(self) -> Generator[Any, None, Run]:
        return self._awaited().__await__()

    async def _awaited(self) -> Run:
        import asyncio

        try:
            async for _ in self.aevents():
                pass
        except asyncio.CancelledError:
            self.stop()
            async for _ in self.aevents():
                pass
            self._over()
            raise
        return self._result()

    def _over(self) -> None:
        """Wait for the thread; nothing is left for the end of this process."""
        self._thread.join()
        atexit.unregister(self._leave)

    def _result(self) -> Run:
        self._over()
        if isinstance(self._failure, TwinError):
            # Its line says what to do; where in our code it was found is of no use to anybody.
            raise self._failure.with_traceback(None)
        if self._failure is not None:
            raise self._failure
        assert self._folder is not None
        return Run(self._folder)

    def _work(self) -> None:
        """Run it; for the thread."""
        from conductor.run.stopping import Interrupted

        try:
            self._run()
        except Interrupted:
            place = self._folder or self._request.campaign
            self._failure = UnfinishedError(f"{place}: stopped; the same call goes on")
        except BaseException as error:
            self._failure = error
        finally:
            _under_way.release()
            self._events.end()

    def _run(self) -> None:
        from conductor.run.requested import made_ready
        from twin.base.software import check_packages
        from twin.fabric.endpoint import demand_keys

        check_packages()
        demand_keys()  # as every command that serves: other users of this host reach its loopback
        with made_ready(self._request) as ready:
            from conductor.run.command import carry_out

            self._folder = ready.options.out
            carry_out(
                ready.plan,
                ready.options,
                ready.workers,
                ready.computed,
                self._events,
                self._signals,
            )

    def _leave(self) -> None:
        """Stop what nobody has waited for, when this process ends."""
        self.stop()
        self._thread.join(STOP_S)


class _Events:
    """What a run has said, for any number of listeners; a :class:`RunListener`."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._kept: deque[RunEvent] = deque(maxlen=EVENTS_MAX)
        self._count = 0
        self._ended = False
        self._wakers: list[Callable[[], None]] = []
        self._last: object = None

    def say(self, line: str) -> None:
        self._add(EventLine(line))

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        yield

    def progress(self, progress: RunProgress) -> None:
        if progress != self._last:
            self._last = progress
            self._add(progress)

    def end(self) -> None:
        """Nothing comes any more."""
        with self._changed:
            self._ended = True
            self._tell()

    def since(self, place: int, *, wait: bool = True) -> tuple[list[RunEvent], int]:
        """Events from a place on, and the next place; -1: these were the last."""
        with self._changed:
            while wait and self._count <= place and not self._ended:
                self._changed.wait()
            missed = self._count - place
            found = list(self._kept)[-missed:] if missed > 0 else []
            return found, -1 if self._ended else self._count

    @contextlib.contextmanager
    def waking(self, wake: Callable[[], None]) -> Iterator[None]:
        """Call ``wake`` at every event while the block lasts, on the run's thread."""
        with self._changed:
            self._wakers.append(wake)
        try:
            yield
        finally:
            with self._changed:
                self._wakers.remove(wake)

    def _add(self, event: RunEvent) -> None:
        with self._changed:
            self._kept.append(event)
            self._count += 1
            self._tell()

    def _tell(self) -> None:
        self._changed.notify_all()
        for wake in self._wakers:
            wake()


@contextlib.contextmanager
def _shown(progress: bool) -> Iterator[Callable[[RunEvent], None]]:
    """Show events while the block lasts: on this thread, since notebooks know by it which
    cell they belong to."""
    if not progress:
        yield lambda _: None
        return
    from rich.console import Console

    from conductor.run.bar import BarListener
    from conductor.run.console import listener_here

    console = Console(stderr=True)
    moves = console.is_jupyter and _has_widgets()
    listener = BarListener(console) if moves else listener_here()

    def show(event: RunEvent) -> None:
        if isinstance(event, EventLine):
            listener.say(event.text)
        else:
            listener.progress(event)

    with listener.watching():
        yield show


def _has_widgets() -> bool:
    """Whether a notebook can show what moves."""
    from importlib.util import find_spec

    return find_spec("ipywidgets") is not None
