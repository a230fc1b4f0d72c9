"""Starts the native viewer, with or without a window, and moves it to a moment."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import IO, TypeVar

from rerun.experimental import ViewerClient, ViewerState

from twin.base.errors import InfrastructureError
from twin.base.gpu.vulkan import has_vulkan
from twin.base.process import end, last_lines, spawn
from viewer.playback import native
from viewer.playback.folder import RecordedMoment
from viewer.recording import naming

T = TypeVar("T")

READY_TIMEOUT_S = 30.0
"""Longest time the viewer may take to start, and to load a recording [s]."""

LOAD_TIMEOUT_S = 1.0
"""Longest time that each of many recordings may take besides [s]."""

POLL_S = 0.1
"""Time between two questions whether the viewer is ready [s]."""

NO_VULKAN = (
    "no Vulkan driver to render with; install mesa-vulkan-drivers "
    "(apt-get install mesa-vulkan-drivers), or open the recording on a laptop"
)


@dataclass(frozen=True, slots=True)
class ViewerWindow:
    """A running viewer."""

    process: subprocess.Popen[bytes]
    client: ViewerClient

    def show(self, moment: RecordedMoment) -> None:
        """Wait for the recording it was started with, and stop there.

        Raises:
            InfrastructureError: it does not come.
        """
        self.loaded(1)
        self.pause(moment)

    def loaded(self, count: int) -> ViewerState:
        """Wait for ``count`` recordings.

        Raises:
            InfrastructureError: they do not come.
        """
        until_s = time.monotonic() + READY_TIMEOUT_S + count * LOAD_TIMEOUT_S
        while True:
            state = asked(self.client.get_state)
            there = sum(bool(recording.timelines) for recording in state.recordings)
            if there >= count and not state.loading:
                return state
            if time.monotonic() > until_s:
                raise InfrastructureError(
                    f"viewer: {there} of {count} recordings were loaded in time"
                )
            time.sleep(POLL_S)

    def pause(self, moment: RecordedMoment, recording: str | None = None) -> None:
        """Stop a recording there; None: the one that is shown."""
        when = timedelta(microseconds=moment.sim_time_ns / 1000)
        asked(
            lambda: self.client.set_time(
                naming.SIM_TIME, duration=when, play_state="paused", recording=recording
            ),
        )


@contextmanager
def window(arguments: Sequence[str], *, headless: bool = False) -> Iterator[ViewerWindow]:
    """A viewer on a loopback port; it ends with the block.

    Raises:
        InfrastructureError: it cannot start, e.g. for want of a Vulkan driver.
    """
    if headless and not has_vulkan():
        raise InfrastructureError(NO_VULKAN)
    port = native.free_port()
    # The viewer leaves a folder behind whenever it is ended from outside.
    with (
        tempfile.TemporaryDirectory(prefix="viewer-", ignore_cleanup_errors=True) as folder,
        tempfile.TemporaryFile() as log,
    ):
        child = spawn(
            [
                *(str(native.binary()), "--bind", "127.0.0.1", "--port", str(port)),
                *(["--headless"] if headless else []),
                *arguments,
            ],
            # Warnings about a software renderer would cover the picture.
            environment={"RUST_LOG": "error", "TMPDIR": folder},
            log=log,
        )
        try:
            yield ViewerWindow(child, _ready(child, f"rerun+http://127.0.0.1:{port}/proxy", log))
        finally:
            end(child, 0.5)


def _ready(child: subprocess.Popen[bytes], url: str, log: IO[bytes]) -> ViewerClient:
    until_s = time.monotonic() + READY_TIMEOUT_S
    while True:
        if child.poll() is not None:
            text = last_lines(log)
            no_adapter = "graphics adapter" in text
            raise InfrastructureError(NO_VULKAN if no_adapter else f"viewer: {text[-300:]}")
        try:
            client = ViewerClient.connect(url)
            client.get_state()
            return client
        except (RuntimeError, OSError) as error:
            if time.monotonic() > until_s:
                raise InfrastructureError(f"viewer: not ready: {_line(error)}") from None
            time.sleep(POLL_S)


def asked(call: Callable[[], T]) -> T:
    """The viewer's answer."""
    try:
        return call()
    except (RuntimeError, OSError) as error:
        raise InfrastructureError(f"viewer: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
