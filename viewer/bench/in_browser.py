"""The console's wall in a real browser: when it is there, how smooth it is, and what it keeps.

The figures come from Chromium's own trace and process table. A page of made-up cases is served from
this machine, which computes the browser's pictures in software, too.
"""

from __future__ import annotations

import functools
import http.server
import importlib
import json
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

from twin.base.errors import InfrastructureError, UsageError
from viewer.bench.console_site import write_site

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = ("--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking")
PATIENCE_MS = 60_000

PAINT_MAX_MS = 1500.0
"""Target: the wall of all cases is drawn so long after its address was opened [ms]."""
FRAME_MAX_MS = 100.0
"""Target: no task of the page is longer while it is scrolled, filtered and sorted [ms]."""
MEMORY_MAX_MB = 400.0
"""Target: memory of the page's process that it shares with nobody, at the end [MB]."""

TRACED = ("toplevel", "devtools.timeline", "disabled-by-default-devtools.timeline")
TASKS = ("ThreadControllerImpl::RunTask", "RunTask")

WATCH = """
new MutationObserver((_, observer) => {
  const canvas = document.querySelector('.frame canvas[data-tiles]');
  if (canvas === null || canvas.dataset.tiles === '0') return;
  window.wallDrawnMs = performance.now();
  observer.disconnect();
}).observe(document, {subtree: true, childList: true, attributes: true});
"""
"""Notes when the wall's tiles were first drawn."""
SCROLL = """
([step, frames]) => new Promise((resolve) => {
  const box = document.querySelector('.frame, .rows');
  const next = (left) => {
    if (left === 0) return resolve(box.scrollTop);
    box.scrollTop += step;
    requestAnimationFrame(() => next(left - 1));
  };
  next(frames);
})
"""
SETTLE = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


def measure_page(count: int) -> dict[str, Any]:
    """First paint, longest tasks and memory of a page with ``count`` cases.

    Raises:
        UsageError: Playwright or Chromium is missing.
        InfrastructureError: the browser gives no trace.
    """
    try:
        playwright = importlib.import_module("playwright.sync_api").sync_playwright()
    except ImportError:
        raise UsageError(
            "--page: install the package 'playwright' (pip install playwright)"
        ) from None
    if not CHROMIUM.exists():
        raise UsageError("--page: install the Debian package 'chromium'")
    with tempfile.TemporaryDirectory(prefix="viewer-bench-") as folder:
        site = Path(folder) / "site"
        write_site(site, count, static=False)
        runs = site / "data" / "runs.json"
        runs.write_text(json.dumps({**json.loads(runs.read_text()), "live": False}))
        with _served(site) as url, playwright as driver:
            browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=list(ARGUMENTS))
            try:
                return {"cases": count} | _measured(browser, f"{url}#/run/made-up/wall")
            finally:
                browser.close()


def misses(found: dict[str, Any]) -> list[str]:
    """A line per target that was missed."""
    missed = []
    if found["paint_ms"] > PAINT_MAX_MS:
        missed.append(f"page: drawn after {found['paint_ms']:.0f} ms, at most {PAINT_MAX_MS:.0f}")
    for name, longest in found["longest_task_ms"].items():
        if longest > FRAME_MAX_MS:
            missed.append(f"page: {name}: a task of {longest:.0f} ms, at most {FRAME_MAX_MS:.0f}")
    if found["memory_mb"] > MEMORY_MAX_MB:
        missed.append(f"page: {found['memory_mb']:.0f} MB, at most {MEMORY_MAX_MB:.0f}")
    return missed


def lines(found: dict[str, Any]) -> list[str]:
    """The figures for people."""
    busy = found["longest_task_cpu_ms"]
    tasks = ", ".join(
        f"{name} {wall:.0f} ({busy[name]:.0f})" for name, wall in found["longest_task_ms"].items()
    )
    return [
        f"page with {found['cases']} cases: wall drawn after {found['paint_ms']:.0f} ms, "
        f"{found['memory_mb']:.0f} MB at the end ({found['heap_mb']:.0f} MB of objects)",
        f"  longest task [ms], by processor time in brackets: {tasks}",
    ]


def _measured(browser: Any, url: str) -> dict[str, Any]:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(WATCH)
    page.goto(url)
    drawn = page.locator(".frame canvas[data-tiles]")
    drawn.wait_for()
    longest = {
        name: _longest_task_ms(browser, page, act)
        for name, act in (
            ("scroll pictures", lambda: page.evaluate(SCROLL, [90, 150])),
            ("zoom to dots", lambda: page.get_by_label("Size").fill("4")),
            ("scroll dots", lambda: page.evaluate(SCROLL, [40, 60])),
            ("filter", lambda: _type(page, "weather=heavy_fog dtc_min_m<8")),
            ("clear filter", lambda: page.get_by_role("searchbox").fill("")),
            ("sort", lambda: page.get_by_label("Sort").select_option("dtc_min_m")),
            ("group", lambda: page.get_by_label("Across").select_option("weather")),
            ("heat map", lambda: page.get_by_label("Down").select_option("model")),
            ("scroll heat map", lambda: page.evaluate(SCROLL, [60, 60])),
            ("rows", lambda: page.get_by_role("button", name="Rows").click()),
            ("scroll rows", lambda: page.evaluate(SCROLL, [400, 120])),
        )
    }
    return {
        "paint_ms": page.evaluate("window.wallDrawnMs"),
        "longest_task_ms": {name: wall for name, (wall, _) in longest.items()},
        "longest_task_cpu_ms": {name: busy for name, (_, busy) in longest.items()},
        "heap_mb": page.evaluate("performance.memory.usedJSHeapSize") / 1e6,
        "memory_mb": _memory_mb(browser),
    }


def _type(page: Any, words: str) -> None:
    page.get_by_role("searchbox").press_sequentially(words, delay=30)
    page.locator("#filter-says").filter(has_text="of").wait_for()
    page.wait_for_timeout(200)


def _longest_task_ms(browser: Any, page: Any, act: Any) -> tuple[float, float]:
    """Longest task on the page's main thread while ``act`` is carried out and drawn, by the wall
    clock and by its processor time."""
    browser.start_tracing(page=page, categories=list(TRACED))
    act()
    page.evaluate(SETTLE)
    page.wait_for_timeout(150)
    events = json.loads(browser.stop_tracing())["traceEvents"]
    mains = {
        (event["pid"], event["tid"])
        for event in events
        if event.get("name") == "thread_name" and event["args"].get("name") == "CrRendererMain"
    }
    tasks = [
        (event["dur"] / 1000, event.get("tdur", 0) / 1000)
        for event in events
        if event.get("name") in TASKS and (event["pid"], event["tid"]) in mains and "dur" in event
    ]
    if not tasks:
        raise InfrastructureError("the browser's trace names no task of the page")
    return max(wall for wall, _ in tasks), max(busy for _, busy in tasks)


def _memory_mb(browser: Any) -> float:
    """Memory of the largest page process that no other shares."""
    session = browser.new_browser_cdp_session()
    found = session.send("SystemInfo.getProcessInfo")["processInfo"]
    pages = [int(one["id"]) for one in found if one["type"] == "renderer"]
    return max(psutil.Process(pid).memory_full_info().uss for pid in pages) / 1e6


class _Quiet(http.server.SimpleHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_: object) -> None:
        """Says nothing."""


@contextmanager
def _served(folder: Path) -> Iterator[str]:
    handler = functools.partial(_Quiet, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, name="site", daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()
