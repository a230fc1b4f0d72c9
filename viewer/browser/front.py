"""The front: the console, recordings and the live hub's stream behind one loopback port.

Pages load nothing from elsewhere: a Content-Security-Policy forbids it, also to Rerun's own code,
which would otherwise ask for fonts, news and statistics.
"""

from __future__ import annotations

import contextlib
import hashlib
import http.client
import json
import os
import select
import socket
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import IO, Any, Protocol
from urllib.parse import parse_qs, unquote, urlsplit

from schemas.files.regular_file import open_below, open_regular
from twin.base.errors import TwinError, UsageError
from twin.fabric.loopback import is_ours, is_own_name
from viewer.browser.assets import PLOTLY, Asset, plotly_script
from viewer.browser.desk import Desk, refusal
from viewer.console.live_console import LiveConsole
from viewer.console.run_folder import RunFolder
from viewer.console.shown_run import JSON, SiteAnswer, as_json
from viewer.console.site import ConsoleSite
from viewer.console.stream import BEAT, HEARTBEAT_S, sse
from viewer.playback.catalogue import read_row
from viewer.playback.folder import find_recording

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; worker-src 'self' blob:; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Content-Security-Policy: this front only, whatever a script wants."""

READS = "/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages"
"""The one call of the hub that is passed on: browsers look, and write nothing."""

STEERS = "/steer"
"""Path to which the control panel posts."""
ACTS = "/act/"
"""Begins the paths to which the console posts."""

BODY_BYTES_MAX = 1 << 16
"""Largest request [bytes]."""

STRANGERS = (
    b"HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
    b"this page belongs to another user; start viewer web yourself\n"
)
"""What other users of this host are told."""

DOWNLOADS_MAX = 16
"""Most recordings on their way at once; a browser asks for one per page."""

LENGTH_DIGITS_MAX = 18
"""Longer numbers are not even read: Python refuses some of them."""

HUB_S = 10.0
"""Longest time the hub may take to begin its answer [s]."""

WATCH_S = 1.0
"""Time between two looks for the end of a stream while its browser is watched [s]."""

PIECE_BYTES = 1 << 16
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""Content-Security-Policy of a report, whose scripts are in its page: it has an origin of its own,
reads nothing of ours, and asks nobody."""
REPORT_BYTES_MAX = 256 << 20
"""Largest report that is shown [bytes]."""

BUILT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Suffixes of the console's built files, and their types."""
_PAGES = {
    "case.html": "text/html; charset=utf-8",
    "case.js": "text/javascript; charset=utf-8",
    "panel.js": "text/javascript; charset=utf-8",
    "style.css": "text/css; charset=utf-8",
}


class HasFiles(Protocol):
    """Files by name, as a dict has them or :class:`viewer.browser.assets.WebViewer`."""

    def get(self, name: str, /) -> Asset | None:
        """A file; None: there is none. Raises TwinError: it cannot be made."""


@dataclass(frozen=True, slots=True)
class SingleRecording:
    """A recording that belongs to no campaign."""

    path: Path
    name: str
    at_s: float | None
    """Moment at which it opens, paused [s]; None: it does as its layout says."""

    def as_json(self) -> dict[str, Any]:
        """What its page needs to know."""
        row = {"case": self.name, "verdict": "", "complete": True, "moment_s": self.at_s}
        return {"live": False, "single": True, "name": self.name, "cases": [row], "missing": []}


@dataclass(frozen=True, slots=True)
class ShownSite:
    """What is shown."""

    assets: HasFiles
    """Rerun's web viewer."""
    console: ConsoleSite | None = None
    """Campaigns and their cases; None: there is a single recording only."""
    at: str = "aeb"
    """Moment at which recordings open."""
    hub: Callable[[], tuple[str, int] | None] | None = None
    """Host and port of a live hub, which is started when first asked for; None: nothing is live."""
    live: LiveConsole | None = None
    """What runs now, for the console; None: nothing is live."""
    desk: Desk | None = None
    """Way to running cases, for pages that know its token; None: there is none."""
    single: SingleRecording | None = None
    """The only recording, in place of a console."""

    def about(self, run: str, case: str) -> bytes:
        """What Rerun's page needs to know, as JSON; ``case`` empty: of the running ones.

        Raises:
            UsageError: there is no such case, or no recording; or nothing runs.
        """
        if self.single is not None:
            return json.dumps(self.single.as_json()).encode()
        if not case:
            if self.hub is None:
                raise UsageError("nothing is live here; choose a case in the console")
            return json.dumps({"live": True, "cases": []}).encode()
        row = read_row(self.run(run).folder, case, self.at).as_json()
        del row["path"]
        return json.dumps({"live": False, "name": run, "cases": [row]}).encode()

    def run(self, name: str) -> RunFolder:
        """A campaign; an empty name means the only one.

        Raises:
            UsageError: there is no such campaign.
        """
        if self.console is None:
            raise UsageError("there is no campaign here")
        return self.console.run(name)


class BrowserFront(ThreadingHTTPServer):
    """Serves a site on 127.0.0.1."""

    daemon_threads = True

    def __init__(self, port: int, site: ShownSite) -> None:
        """Listen; ``port`` 0: a free one.

        Raises:
            UsageError: the port is in use.
        """
        self.site = site
        self.plotly = cache(plotly_script)
        self.downloads = threading.BoundedSemaphore(DOWNLOADS_MAX)
        self.files = {name: _page(name, kind) for name, kind in _PAGES.items()}
        self.files |= built_pages() if site.single is None else {}
        try:
            super().__init__(("127.0.0.1", port), Handler)
        except OSError as error:
            raise UsageError(
                f"--port {port}: {error.strerror}; choose another, or 0 for a free one"
            ) from None

    @property
    def url(self) -> str:
        """Address for browsers of this host."""
        return f"http://127.0.0.1:{self.server_address[1]}/"

    def verify_request(self, request: Any, *_: Any) -> bool:
        """Whether it comes from a process of ours: loopback is open to other users as well."""
        if is_ours(request):
            return True
        with contextlib.suppress(OSError):
            request.sendall(STRANGERS)
        return False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that went away in the middle is no error."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: BrowserFront
    protocol_version = "HTTP/1.1"
    timeout = 60.0
    policy = POLICY

    def do_GET(self) -> None:
        """Pages, their files, the catalogue and recordings."""
        if not self._welcome():
            return
        try:
            asked = urlsplit(self.path)
        except ValueError:
            self.close_connection = True
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        path, query = asked.path, parse_qs(asked.query)
        site, desk = self.server.site, self.server.site.desk
        if path == "/":
            self._page("case.html" if site.single is not None else "index.html")
        elif path == "/view":
            self._page("case.html")
        elif path == "/about.json":
            run, case = (query.get(name, [""])[0] for name in ("run", "case"))
            self._made(lambda: (site.about(run, case), "application/json"))
        elif path == "/running.json" and desk is not None:
            self._made(lambda: (desk.cases(), "application/json"))
        elif path.startswith("/data/") and site.console is not None:
            self._data(site.console, path.removeprefix("/data/"))
        elif path.startswith("/recording/") and path.endswith(".rrd"):
            self._download(path.removeprefix("/recording/").removesuffix(".rrd"))
        elif path.startswith("/report/") and path.endswith("/report.html"):
            self._report(unquote(path.removeprefix("/report/").removesuffix("/report.html")))
        elif path.removeprefix("/") in self.server.files:
            self._page(path.removeprefix("/"))
        else:
            self._viewer_file(path.removeprefix("/"))

    def do_POST(self) -> None:
        """The live stream, passed on from the hub as it comes; and what the panel asks."""
        if not self._welcome():
            return
        site, length = self.server.site, self.headers.get("Content-Length", "")
        desk = site.desk
        asks = desk is not None and (self.path == STEERS or self.path.startswith(ACTS))
        if site.hub is None or not (self.path == READS or asks):
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not (length.isascii() and length.isdecimal()):
            self._refuse(HTTPStatus.BAD_REQUEST)
        elif len(length) > LENGTH_DIGITS_MAX or int(length) > BODY_BYTES_MAX:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        elif desk is not None and asks and not self._trusted(desk):
            self._refuse(HTTPStatus.FORBIDDEN, "open the address that viewer web printed")
        elif desk is not None and asks:
            self._do(desk, self.rfile.read(int(length)))
        elif (address := site.hub()) is None:
            self._refuse(HTTPStatus.BAD_GATEWAY, "the live hub is gone")
        else:
            self._pass_on(address, self.rfile.read(int(length)))

    def log_message(self, *_: object) -> None:
        """Says nothing."""

    def end_headers(self) -> None:
        """What every answer says."""
        self.send_header("Content-Security-Policy", self.policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        super().end_headers()

    def _welcome(self) -> bool:
        """Asked under our own name, by our own page or by nobody's."""
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin")
        # No page of another site can ask in its own name.
        if is_own_name(host) and origin in (None, f"http://{host}"):
            return True
        self.close_connection = True
        self.send_error(HTTPStatus.FORBIDDEN, "ask for localhost")
        return False

    def _refuse(self, status: HTTPStatus, words: str | None = None) -> None:
        """Answer without having read what else was sent."""
        self.close_connection = True
        self.send_error(status, words)

    def _trusted(self, desk: Desk) -> bool:
        """Asked by our own page, which knows the token; no other site can send such a request."""
        kind = self.headers.get("Content-Type", "").partition(";")[0]
        token = self.headers.get("X-Steer-Token", "")
        ours = self.headers.get("Origin") is not None  # which one, `_welcome` has looked at
        return ours and kind == "application/json" and desk.knows(token)

    def _do(self, desk: Desk, body: bytes) -> None:
        """What a trusted page asks to be done."""
        live = self.server.site.live
        status = HTTPStatus.OK
        try:
            if self.path == STEERS:
                data = desk.do(body)
            elif live is None:
                raise UsageError("nothing is live here")
            else:
                data = as_json(live.act(self.path.removeprefix(ACTS), body)).data
        except TwinError as error:
            status, data = HTTPStatus.CONFLICT, refusal(error)
        self._answer(status, data, JSON)

    def _page(self, name: str) -> None:
        """A file of the pages; that of the console is built apart."""
        if name in self.server.files:
            self._file(self.server.files[name])
            return
        words = b"the console's page is not built: run `make console`"
        self._answer(HTTPStatus.NOT_FOUND, words, "text/plain; charset=utf-8")

    def _viewer_file(self, name: str) -> None:
        """A file of Rerun's viewer, or Plotly."""
        try:
            file = self.server.plotly() if name == PLOTLY else self.server.site.assets.get(name)
        except TwinError as error:
            self._missing(error)
            return
        if file is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            self._file(file)

    def _data(self, console: ConsoleSite, path: str) -> None:
        """What the console's page asks for, by the same rules as a file of it."""
        live = self.server.site.live
        if live is not None and path == "events":
            self._events(live)
            return
        try:
            self._file(self._live_answer(live, console, path) or console.answer(path))
        except (TwinError, OSError) as error:
            waits = live is not None and live.waits
            self._missing(error, HTTPStatus.SERVICE_UNAVAILABLE if waits else HTTPStatus.NOT_FOUND)

    def _live_answer(
        self, live: LiveConsole | None, console: ConsoleSite, path: str
    ) -> SiteAnswer | None:
        """What depends on who asks, and when; None: it does not."""
        if path == "runs.json" and live is not None:
            desk = self.server.site.desk
            trusted = desk is not None and desk.knows(self.headers.get("X-Steer-Token", ""))
            return as_json(console.runs_json() | {"roles": live.role(trusted)})
        if path.startswith("runs/") and path.endswith("/workers.json") and live is not None:
            run = unquote(path.removeprefix("runs/").removesuffix("/workers.json"))
            return as_json(live.workers(run))
        return None

    def _events(self, live: LiveConsole) -> None:
        """Events as they come, from where the page was, until it goes or we end."""
        self.close_connection = True
        stream = live.stream
        query = parse_qs(urlsplit(self.path).query)
        last_id = self.headers.get("Last-Event-ID") or query.get("since", [""])[0]
        with stream.followed() as welcome:
            if not welcome:
                self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages; close one")
                return
            number, resync = stream.after(last_id)
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream; charset=utf-8")
            self.send_header("Cache-Control", "no-store")
            self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(sse("hello", live.hello(resync), f"{stream.epoch}-{number}"))
            while not stream.closed:
                events = stream.wait(number, HEARTBEAT_S)
                if events is None:
                    return  # too slow: it comes back, and asks for all anew
                self.wfile.write(b"".join(event.text for event in events) or BEAT)
                number = events[-1].number if events else number

    def _report(self, run: str) -> None:
        """The report of a campaign, in a sandbox."""
        try:
            data = self.server.site.run(run).read("report.html", REPORT_BYTES_MAX)
        except (TwinError, OSError) as error:
            self._missing(error)
            return
        self.policy = REPORT_POLICY
        try:
            self._answer(HTTPStatus.OK, data, "text/html; charset=utf-8")
        finally:
            self.policy = POLICY

    def _file(self, file: Asset | SiteAnswer) -> None:
        """A file that browsers may keep as long as its tag stays."""
        tag = f'"{file.tag}"'
        packs = not file.media_type.startswith("image/")
        packed = packs and "gzip" in self.headers.get("Accept-Encoding", "")
        if self.headers.get("If-None-Match") == tag:
            self.send_response(HTTPStatus.NOT_MODIFIED)
            self.send_header("ETag", tag)
            self.end_headers()
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", file.media_type)
        self.send_header("Cache-Control", "no-cache")
        self.send_header("Vary", "Accept-Encoding")
        self.send_header("ETag", tag)
        data = file.packed if packed else file.data
        if packed:
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _made(self, make: Callable[[], tuple[bytes, str]]) -> None:
        """Something that is read now."""
        try:
            data, media_type = make()
        except (TwinError, OSError) as error:
            self._missing(error)
        else:
            self._answer(HTTPStatus.OK, data, media_type)

    def _missing(self, error: Exception, status: HTTPStatus = HTTPStatus.NOT_FOUND) -> None:
        self._answer(status, str(error).encode(), "text/plain; charset=utf-8")

    def _answer(self, status: HTTPStatus, data: bytes, media_type: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", media_type)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _download(self, address: str) -> None:
        """A recording, from the disk to the line: however large, nothing of it lies in memory."""
        try:
            file = _recording(self.server.site, address)
        except (TwinError, OSError) as error:
            self._missing(error)
            return
        with file:
            if not self.server.downloads.acquire(blocking=False):
                self.close_connection = True
                self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, "too many downloads; ask again")
                return
            try:
                size = os.fstat(file.fileno()).st_size
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "application/octet-stream")
                self.send_header("Cache-Control", "no-store")
                self.send_header("Content-Length", str(size))
                self.end_headers()
                # A file that grows meanwhile must not put more on the line than was announced.
                if self.connection.sendfile(file, 0, size) < size:
                    self.close_connection = True
            finally:
                self.server.downloads.release()

    def _pass_on(self, hub: tuple[str, int], body: bytes) -> None:
        self.close_connection = True
        upstream = http.client.HTTPConnection(*hub, timeout=HUB_S)
        kept = ("content-type", "accept", "x-grpc-web", "x-user-agent", "grpc-timeout")
        headers = {name: self.headers[name] for name in kept if name in self.headers}
        try:
            upstream.connect()
            line = upstream.sock
            upstream.request("POST", self.path, body, headers)
            answer = upstream.getresponse()
        except (OSError, http.client.HTTPException):
            upstream.close()
            self.send_error(HTTPStatus.BAD_GATEWAY, "the live hub is gone")
            return
        line.settimeout(None)  # there may be nothing to show for long
        over = threading.Event()
        threading.Thread(target=self._watch, args=(line, over), name="watch", daemon=True).start()
        try:
            self.send_response(answer.status)
            for name, value in answer.getheaders():
                if name.lower() in ("content-type", "grpc-status", "grpc-message"):
                    self.send_header(name, value)
            self.send_header("Connection", "close")
            self.end_headers()
            while piece := answer.read1(PIECE_BYTES):
                self.wfile.write(piece)
        except http.client.HTTPException:
            return  # the hub ended in the middle, and so does what is passed on of it
        finally:
            over.set()
            upstream.close()

    def _watch(self, line: socket.socket, over: threading.Event) -> None:
        """Cut the hub's line when the browser goes away while nothing comes to be passed on."""
        # The end of the stream closes both sockets under our hands.
        with contextlib.suppress(OSError, ValueError):
            while not over.is_set():
                if select.select([self.connection], [], [], WATCH_S)[0]:
                    if not self.connection.recv(1, socket.MSG_PEEK):
                        line.shutdown(socket.SHUT_RDWR)
                    return


def _page(name: str, media_type: str) -> Asset:
    data = resources.files("viewer.browser").joinpath("pages", name).read_bytes()
    return _asset(data, media_type)


def built_pages() -> dict[str, Asset]:
    """The console's page as it was built, by name; empty: it was not."""
    folder = resources.files("viewer.console").joinpath("built")
    if not folder.is_dir():
        return {}
    return {
        file.name: _asset(file.read_bytes(), kind)
        for file in folder.iterdir()
        if (kind := BUILT_TYPES.get(Path(file.name).suffix)) is not None
    }


def _asset(data: bytes, media_type: str) -> Asset:
    return Asset(data, media_type, hashlib.sha256(data).hexdigest()[:16])


def _recording(site: ShownSite, address: str) -> IO[bytes]:
    """The recording ``RUN/CASE``, quoted, of the only campaign ``CASE``; or the single one."""
    if site.single is not None:
        if unquote(address) != site.single.name:
            raise UsageError("there is one recording here, and it has another name")
        return open_regular(site.single.path)
    run, _, case = address.rpartition("/")
    folder = site.run(unquote(run)).folder
    path = find_recording(folder, unquote(case)).path
    return open_below(folder, str(path.relative_to(folder)))
