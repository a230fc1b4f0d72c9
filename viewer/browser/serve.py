"""`viewer web`: runs the front, and for live cases what stands behind it, until Ctrl-C."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

from schemas.words import counted
from twin.base.command import StopSignal
from twin.base.errors import UsageError
from twin.base.process import end, spawn
from viewer.browser.assets import WebViewer
from viewer.browser.desk import Desk
from viewer.browser.front import BrowserFront, ShownSite, SingleRecording, built_pages
from viewer.console.live_console import LiveConsole
from viewer.console.run_folder import RunFolder, find_runs
from viewer.console.site import ConsoleSite
from viewer.console.static_site import write_static
from viewer.live.command import LiveOptions, say
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


def run_web(options: WebOptions) -> int:
    """Serve until Ctrl-C; the exit code."""
    stop = StopSignal()
    if options.file is not None:
        at_s = None if options.moment is None else options.moment.sim_time_ns / 1e9
        single = SingleRecording(options.file, options.case, at_s)
        _serve(ShownSite(WebViewer(), single=single), options, stop)
        return 0
    console = ConsoleSite(_runs(options))
    if options.where is None:
        _serve(ShownSite(WebViewer(), console, options.at), options, stop)
        return 0
    tunnel = options.where.tunnel()
    resolve = options.where.target if tunnel is None else tunnel.target
    # Pages ask while the tunnel is dug; they must not wait for it, nor dig a second one.
    desk = Desk(resolve if tunnel is None else tunnel.standing)
    hub = LiveHub(options.live, stop)
    live = LiveConsole(console, resolve, desk, here=options.folder is not None, say=say)
    try:
        live.start()
        site = ShownSite(WebViewer(), console, options.at, hub=hub.address, live=live, desk=desk)
        _serve(site, options, stop)
    finally:
        if tunnel is not None:
            tunnel.close()  # first: the console may be waiting for it
        live.close()
        hub.close()
        desk.close()
    if live.watch.error is not None:
        raise live.watch.error
    return 0


def write_files(folder: Path, out: Path, *, recordings: bool, as_json: bool) -> int:
    """Write the console of the campaigns of ``folder`` into ``out``; the exit code.

    Raises:
        UsageError: there is no campaign, or ``out`` cannot be written.
    """
    written = write_static(
        ConsoleSite(find_runs(folder)), built_pages(), out, recordings=recordings
    )
    for line in written.left_out:
        say(line)
    if as_json:
        print(json.dumps({"files": written.files, "bytes": written.size_bytes}))
    else:
        size = f"{written.size_bytes / 1e6:.1f} MB"
        print(f"{out}: {counted(written.files, 'file')}, {size}; open {out / 'index.html'}")
    return 0


def _runs(options: WebOptions) -> list[RunFolder]:
    """The campaigns that are shown from the start; a conductor's folder may have none yet."""
    if options.folder is None:
        return []
    if options.where is None:
        return find_runs(options.folder)
    try:
        return find_runs(options.folder)
    except UsageError:
        return []


def _serve(site: ShownSite, options: WebOptions, stop: StopSignal) -> None:
    with BrowserFront(options.port, site) as front:
        threading.Thread(target=front.serve_forever, name="front", daemon=True).start()
        _tell(front, options)
        if site.console is not None:
            threading.Thread(target=site.console.warm, name="warm", daemon=True).start()
        while not stop.wait(POLL_S):
            if site.live is not None and site.live.watch.error is not None:
                break
        front.shutdown()


class LiveHub:
    """`viewer live` as a child without a window, started when a page first asks for Rerun's wall:
    until then nobody pays for it."""

    def __init__(self, arguments: Sequence[str], stop: StopSignal) -> None:
        self._arguments, self._stop = arguments, stop
        self._child: subprocess.Popen[bytes] | None = None
        self._address: tuple[str, int] | None = None
        self._lock = threading.Lock()

    def address(self) -> tuple[str, int] | None:
        """Host and port of the hub; None: it did not start, or has ended. Its errors are on our
        standard error."""
        with self._lock:
            if self._child is not None and self._child.poll() is not None:
                self._child, self._address = None, None
            if self._child is None:
                command = [sys.executable, "-m", "viewer", "live", *self._arguments]
                command += ["--no-window", "--output", "json"]
                self._child = spawn(command, log=sys.stderr.buffer, pipe_output=True)
                self._address = _hub_address(self._child, self._stop)
            return self._address

    def close(self) -> None:
        """End the child."""
        with self._lock:
            if self._child is not None:
                end(self._child, END_GRACE_S)


def _hub_address(child: subprocess.Popen[bytes], stop: StopSignal) -> tuple[str, int] | None:
    """Host and port of the child's hub; None: we were told to stop, or it ended before it had
    one."""
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
        return None
    address = urlsplit(json.loads(lines[0])["hub"].removeprefix("rerun+"))
    return address.hostname or "127.0.0.1", address.port or 0


def _tell(front: BrowserFront, options: WebOptions) -> None:
    path = ""
    if options.case and options.moment is not None:
        seconds = options.moment.sim_time_ns / 1e9
        run = f"run={quote(_only(front.site))}&" if front.site.console is not None else ""
        path = f"view?{run}case={quote(options.case)}#when=sim_time@+{seconds:g}s"
    if front.site.desk is not None:
        # Behind the '#': browsers keep it to themselves, and pages take it from there.
        path = f"#steer={front.site.desk.token}"
    port = front.server_address[1]
    tunnel = f"ssh -N -L {LAPTOP_PORT}:127.0.0.1:{port} {native.here()}"
    far = f"http://localhost:{LAPTOP_PORT}/{path}"
    if options.json:
        print(json.dumps({"url": front.url + path, "laptop": [tunnel, far]}), flush=True)
        return
    print(f"{front.url}{path}  (Ctrl-C ends)", flush=True)
    if options.where is not None and options.where.ssh:
        return  # this is the laptop
    print("on a laptop behind ssh:")
    print(f"  {tunnel}")
    print(f"then open {far}", flush=True)


def _only(site: ShownSite) -> str:
    assert site.console is not None
    return next(iter(site.console.runs), "")
