"""Attacks on the console: from pages of other sites, and by what lies in a run's folder."""

from __future__ import annotations

import http.client
import json
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
