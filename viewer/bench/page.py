"""A page of the console without a browser: follows the events and asks for the pictures it sees.

Run as ``python -m viewer.bench.page URL``; a child of ``viewer bench``. What a browser needs to
draw does not count, because browsers are on other machines.
"""

from __future__ import annotations

import http.client
import json
import sys
import threading
import time
from urllib.parse import quote, urlsplit

from twin.base.process import bind_to_parent, watch_lifeline

SEEN = 60
"""Pictures of the wall that are on the screen."""
LINES = 4
"""Connections for pictures; browsers open six to one host, one of which has the events."""
PATIENCE_S = 30.0
"""Longest time for an answer [s]."""
POLL_S = 0.2
"""Time between two looks for the first campaign [s]."""
RUNS_S = 3.0
"""Time between two looks for further campaigns, as of the page in a browser [s]."""


def main(url: str) -> None:
    """Look until our parent ends; prints every second how many pictures were given."""
    bind_to_parent()
    watch_lifeline()
    address = urlsplit(url).netloc
    first = http.client.HTTPConnection(address, timeout=PATIENCE_S)
    while not (runs := _get(first, "data/runs.json")["runs"]):
        time.sleep(POLL_S)  # the conductor has not said anything yet
    base = f"/data/runs/{quote(runs[0]['id'])}"
    page = _Page(address, base)
    line = http.client.HTTPConnection(address, timeout=PATIENCE_S)
    line.request("GET", "/data/events")
    answer = line.getresponse()
    kind = ""
    page.tell_every(1.0)
    while text := answer.readline():
        if text.startswith(b"event: "):
            kind = text[7:].strip().decode()
        elif text.startswith(b"data: "):
            page.event(kind, json.loads(text[6:]))


class _Page:
    """What the page knows, and its connections for pictures."""

    def __init__(self, address: str, base: str) -> None:
        self._address, self._base = address, base
        self._cases: list[str] = []
        self._waiting: dict[int, tuple[int, float]] = {}
        """Place of a case -> number of its picture, and when it was made."""
        self._runs_s = time.monotonic()
        self._change = threading.Condition()
        self._line = http.client.HTTPConnection(address, timeout=PATIENCE_S)
        self.seen = 0
        self.lag_s: float | None = None
        """Longest time from the simulator's being there to the picture's being here [s]; None:
        no picture came, or nobody knows it of all."""
        self._known = True
        """Whether all ages since the last word counted from the simulator."""
        for _ in range(LINES):
            threading.Thread(target=self._load, daemon=True).start()

    def tell_every(self, period_s: float) -> None:
        """Print how many pictures have been loaded, again and again."""

        def tell() -> None:
            while True:
                time.sleep(period_s)
                with self._change:
                    lag_s = self.lag_s if self._known else None
                    self.lag_s, self._known = None, True
                    said = {"pictures": self.seen, "lag_s": lag_s}
                print(json.dumps(said), flush=True)

        threading.Thread(target=tell, daemon=True).start()

    def event(self, kind: str, data: dict) -> None:  # type: ignore[type-arg]
        """Take in what was said, and ask for what the wall in a browser asks for."""
        now_s = time.monotonic()
        if now_s - self._runs_s >= RUNS_S:  # the stream says something every second
            self._runs_s = now_s
            _get(self._line, "data/runs.json")
        if kind == "hello" or (kind == "table" and data.get("reset")):
            self._cases = _get(self._line, f"{self._base}/table.json".lstrip("/"))["cases"]
        elif kind == "table":
            self._cases += data["cases"]
        elif kind == "picture":
            with self._change:
                self._known &= data["from"] == "simulator"
                fresh = {
                    index: (number, now_s - age_s)
                    for index, number, _, age_s in data["pictures"]
                    if index < SEEN
                }
                self._waiting |= fresh
                self._change.notify(len(fresh))

    def _load(self) -> None:
        line = http.client.HTTPConnection(self._address, timeout=PATIENCE_S)
        while True:
            with self._change:
                while not self._waiting:
                    self._change.wait()
                index, (number, made_s) = self._waiting.popitem()
            if index >= len(self._cases):
                continue
            case = quote(self._cases[index])
            line.request("GET", f"{self._base}/cases/{case}/moment.webp?v={number}")
            if line.getresponse().read():
                with self._change:
                    self.seen += 1
                    self.lag_s = round(max(self.lag_s or 0.0, time.monotonic() - made_s), 3)


def _get(line: http.client.HTTPConnection, path: str) -> dict:  # type: ignore[type-arg]
    line.request("GET", f"/{path}")
    found: dict = json.loads(line.getresponse().read())  # type: ignore[type-arg]
    return found


if __name__ == "__main__":
    main(sys.argv[1])
