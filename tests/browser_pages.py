"""A browser on the console's page: nobody is asked outside, nothing is said on its console."""

from __future__ import annotations

import contextlib
import functools
import http.server
import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from free_ports import reserved_port

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = ["--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking"]
PATIENCE_MS = 120_000
"""Drawing in software, on a machine with other work."""
BEAT_S = 1.0
"""Longest silence of a :class:`LiveSite` [s]."""
CUT = ("ERR_", "Failed to fetch", "Failed to load resource")
"""What Chromium says on the console by itself when a line is cut."""
AXE_VERSION = "4.14.1"
"""Of axe-core (MPL-2.0), which a test fetches by npm into a folder of its own."""


class OpenedPages:
    """Pages of one test, and what went wrong on them."""

    def __init__(self, browser: Any) -> None:
        self.browser = browser
        self.asked: list[str] = []
        self.said: list[str] = []
        self.allowed: list[str] = []
        """Beginnings of messages that a test provokes."""

    def open(
        self,
        url: str,
        *,
        width: int = 1280,
        height: int = 800,
        theme: str = "light",
        clock: bool = False,
    ) -> Any:
        """A page of a window of its own; ``clock``: a test may turn its clock on."""
        context = self.browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=theme, reduced_motion="reduce"
        )
        context.grant_permissions([])
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.said.append(f"error: {error}"))
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        if clock:
            page.clock.install()
        page.goto(url)
        return page

    def check(self, *hosts: str) -> None:
        """Nobody but ``hosts`` was asked, and nothing was said but what a test provoked."""
        inner = (*hosts, "data:", "blob:")
        assert self.asked
        assert [url for url in self.asked if not url.startswith(inner)] == []
        said = [words for words in self.said if not any(part in words for part in self.allowed)]
        assert said == [], said


@contextlib.contextmanager
def chromium(sync_api: Any) -> Iterator[Any]:
    """A browser without a window."""
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        yield browser
        browser.close()


def axe_source(folder: Path) -> str:
    """The text of axe-core; skips where npm or its registry is not there."""
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm: install Node")
    done = subprocess.run(
        [npm, "install", "--no-save", "--no-audit", "--no-fund", f"axe-core@{AXE_VERSION}"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    source = folder / "node_modules" / "axe-core" / "axe.min.js"
    if done.returncode != 0 or not source.exists():
        pytest.skip(f"npm gives no axe-core: {done.stderr.strip().splitlines()[-1:]}")
    return source.read_text()


def findings(page: Any, source: str) -> list[str]:
    """What axe finds on a page as it stands: rule, and the first elements."""
    # The page's policy admits no inline script; the debugger's protocol is none.
    page.evaluate(source)
    found = page.evaluate("axe.run(document, {resultTypes: ['violations'], preload: false})")
    return [
        f"{one['id']}: {[node['html'][:160] for node in one['nodes'][:3]]}"
        for one in found["violations"]
    ]


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    """Files of a folder, without a line per request."""

    def log_message(self, *_: object) -> None:
        """Says nothing."""


@contextlib.contextmanager
def file_server(folder: Path) -> Iterator[str]:
    """Any web server: gives the files of a folder at the address that it yields."""
    handler = functools.partial(QuietHandler, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


class LiveSite:
    """A server of live data on a port that stays: stopped, started and told what to send."""

    def __init__(self, folder: Path, role: str = "look") -> None:
        self.folder, self.role = folder, role
        self.talks = True
        """Whether the conductor behind it says anything."""
        self.port = 0
        self.running = ""
        """The case that runs, for acts."""
        self.epoch = "first"
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.resumed: list[str] = []
        """Ids from which pages went on."""
        self.posted: list[tuple[str, dict[str, Any], str]] = []
        self.changed = threading.Condition()
        self._server: http.server.ThreadingHTTPServer | None = None
        self._held = contextlib.ExitStack()
        self._stopped = False
        self._silent = False

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        """Listen, at the port of before."""
        self._stopped = False
        if not self.port:  # while it does not listen, nobody else may be given its port
            self.port = self._held.enter_context(reserved_port())
        handler = type("BoundHandler", (LiveHandler,), {"site": self})
        server = http.server.ThreadingHTTPServer(("127.0.0.1", self.port), handler)
        server.daemon_threads = True
        self._server = server
        threading.Thread(target=server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        """Cut every line, and listen no more."""
        with self.changed:
            self._stopped = True
            self.changed.notify_all()
        assert self._server is not None
        self._server.shutdown()
        self._server.server_close()

    def close(self) -> None:
        """Stop for good."""
        self.stop()
        self._held.close()

    @property
    def cut(self) -> bool:
        """Whether nobody is answered."""
        return self._stopped

    def fall_silent(self) -> None:
        """The network swallows everything: lines stand, and nobody is answered."""
        with self.changed:
            self._silent = True

    def speak(self) -> None:
        """The network is back; who still waits is answered."""
        with self.changed:
            self._silent = False
            self.changed.notify_all()

    def hear(self) -> None:
        """Wait while the network swallows everything."""
        with self.changed:
            self.changed.wait_for(lambda: self._stopped or not self._silent)

    def put(self, kind: str, **data: Any) -> None:
        """Send an event to all who follow, now or when they come back."""
        with self.changed:
            self.events.append((kind, data))
            self.changed.notify_all()

    def _versions(self) -> dict[str, str]:
        """Version of the table of each run."""
        tables = (self.folder / "data" / "runs").glob("*/table.json")
        return {path.parent.name: json.loads(path.read_text())["version"] for path in tables}

    def follow(self, since: str, write: Any) -> None:
        """Write events after an id until the line is cut."""
        epoch, _, number = since.rpartition("-")
        with self.changed:
            self.resumed.append(since)
            known = epoch == self.epoch
            at = int(number) if known else len(self.events)
            hello = {"server": self.epoch, "resync": bool(since) and not known, "log": []}
            hello["version"] = self._versions()
        write(_event("hello", f"{self.epoch}-{at}", {**hello, "conductor_age_s": 0.1}))
        while True:
            self.hear()
            with self.changed:
                if self._stopped:
                    return
                if at >= len(self.events) and not self.changed.wait(BEAT_S):
                    word = _event("workers", "", {"draining": False}) if self.talks else b""
                    if not self._silent:
                        write(_event("beat", "", {}) + word)
                fresh = [] if self._silent else list(enumerate(self.events))[at:]
                if self._stopped:
                    return
            for place, (kind, data) in fresh:
                write(_event(kind, f"{self.epoch}-{place + 1}", data))
            at += len(fresh)


def _event(kind: str, number: str, data: dict[str, Any]) -> bytes:
    head = f"id: {number}\n" if number else ""
    return f"{head}event: {kind}\ndata: {json.dumps(data)}\n\n".encode()


class LiveHandler(QuietHandler):
    """Files, events and acts of a :class:`LiveSite`."""

    site: LiveSite
    protocol_version = "HTTP/1.1"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments, directory=str(self.site.folder))

    def do_GET(self) -> None:
        """Events, runs by role, files."""
        self.site.hear()
        if self.site.cut:
            self.close_connection = True  # a line that was kept open hears nothing either
            return
        path, _, query = self.path.partition("?")
        if path == "/data/events":
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Connection", "close")
            self.end_headers()
            since = self.headers.get("Last-Event-ID") or query.removeprefix("since=")
            try:
                self.site.follow(since, self._write)
            except OSError:
                return
        elif path == "/data/runs.json":
            runs = json.loads((self.site.folder / "data" / "runs.json").read_text())
            trusted = self.headers.get("X-Steer-Token") == "secret-token"
            self._answer(200, {**runs, "roles": self.site.role if trusted else "look"})
        elif path == "/running.json":
            # Two campaigns may run a case of one name.
            attempts = [("another", 3), ("made-up", 7)]
            self._answer(
                200,
                [{"campaign": c, "case": self.site.running, "token": t} for c, t in attempts],
            )
        else:
            super().do_GET()

    def do_POST(self) -> None:
        """Acts: what they would do, then that they are done."""
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        token = self.headers.get("X-Steer-Token", "")
        self.site.posted.append((self.path, body, token))
        done = {"done": "done it"} if body["confirm"] else {"confirm": "It gets no verdict."}
        self._answer(200, done)

    def _write(self, data: bytes) -> None:
        self.wfile.write(data)
        self.wfile.flush()

    def _answer(self, status: int, value: Any) -> None:
        data = json.dumps(value).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)
