"""`viewer web`: runs the front, and for live cases the hub behind it, until Ctrl-C."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

from twin.base.errors import TwinError
from twin.base.process import end, spawn
from twin.base.stop_signal import StopSignal
from viewer.browser.assets import web_viewer
from viewer.browser.desk import Desk
from viewer.browser.front import BrowserFront, ShownSite, SingleRecording
from viewer.live.command import LiveOptions
from viewer.playback import native
from viewer.playback.folder import RecordedMoment

LAPTOP_PORT = 9300
"""Port of the laptop's end of a tunnel in the lines we print."""
POLL_S = 0.2
"""Time between two looks at the hub's process [s]."""
END_GRACE_S = 2.0
"""Longest time the hub's process may take to leave [s]."""


@dataclass(frozen=True, slots=True)
class WebOptions:
    """What the command line says."""

    port: int
    """Port to listen on; 0: a free one."""
    folder: Path | None = None
    at: str = "aeb"
    case: str = ""
    """Case that the printed address opens; empty: the table."""
    moment: RecordedMoment | None = None
    file: Path | None = None
    """A single recording called ``case``, in place of a folder."""
    live: tuple[str, ...] = ()
    """Options of `viewer live`, in place of a recording."""
    where: LiveOptions | None = None
    """Options of the same conductor, for the control panel; None: there is none."""
    json: bool = False


class HubError(TwinError):
    """`viewer live` ended; it has said why."""

    def __init__(self, exit_code: int) -> None:
        super().__init__("")
        self.exit_code = exit_code


def run_web(options: WebOptions) -> int:
    """Serve until Ctrl-C, or until the hub ends; the exit code."""
    stop = StopSignal()
    if not options.live:
        single = None
        if options.file is not None:
            moment = options.moment
            at_s = None if moment is None else moment.sim_time_ns / 1e9
            single = SingleRecording(options.file, options.case, at_s)
        site = ShownSite(web_viewer(), options.folder, options.at, single=single)
        _serve(site, options, stop, None)
        return 0
    assets = web_viewer()
    with _live(options.live) as child:
        address = _hub_address(child, stop)
        if address is not None:
            desk = Desk(options.where) if options.where is not None else None
            try:
                _serve(ShownSite(assets, hub=address, desk=desk), options, stop, child)
            finally:
                if desk is not None:
                    desk.close()
        return child.poll() or 0


def _serve(
    site: ShownSite,
    options: WebOptions,
    stop: StopSignal,
    child: subprocess.Popen[bytes] | None,
) -> None:
    with BrowserFront(options.port, site) as front:
        threading.Thread(target=front.serve_forever, name="front", daemon=True).start()
        _tell(front, options)
        while not stop.wait(POLL_S):
            if child is not None and child.poll() is not None:
                break
        front.shutdown()


@contextmanager
def _live(arguments: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """`viewer live` as a child without a window; its errors are our errors."""
    command = [sys.executable, "-m", "viewer", "live", *arguments]
    command += ["--no-window", "--output", "json"]
    child = spawn(command, log=sys.stderr.buffer, pipe_output=True)
    try:
        yield child
    finally:
        end(child, END_GRACE_S)


def _hub_address(child: subprocess.Popen[bytes], stop: StopSignal) -> tuple[str, int] | None:
    """Host and port of the child's hub; None: we were told to stop.

    Raises:
        HubError: it ended before it had one.
    """
    output = child.stdout
    assert output is not None
    lines: list[bytes] = []

    def read() -> None:
        lines.append(output.readline())
        output.read()  # what it counts at its end must not block it

    threading.Thread(target=read, name="hub", daemon=True).start()
    while not lines:
        if stop.wait(POLL_S):
            return None
    if not lines[0]:
        raise HubError(child.wait())
    address = urlsplit(json.loads(lines[0])["hub"].removeprefix("rerun+"))
    return address.hostname or "127.0.0.1", address.port or 0


def _tell(front: BrowserFront, options: WebOptions) -> None:
    path = ""
    if options.case and options.moment is not None:
        seconds = options.moment.sim_time_ns / 1e9
        path = f"view?case={quote(options.case)}#when=sim_time@+{seconds:g}s"
    if front.site.desk is not None:
        # Behind the '#': browsers keep it to themselves, and pages take it from there.
        path = f"#steer={front.site.desk.token}"
    port = front.server_address[1]
    tunnel = f"ssh -N -L {LAPTOP_PORT}:127.0.0.1:{port} {native.here()}"
    far = f"http://localhost:{LAPTOP_PORT}/{path}"
    if options.json:
        print(json.dumps({"url": front.url + path, "laptop": [tunnel, far]}), flush=True)
        return
    print(f"{front.url}{path}  (Ctrl-C ends)")
    print("on a laptop behind ssh:")
    print(f"  {tunnel}")
    print(f"then open {far}", flush=True)
