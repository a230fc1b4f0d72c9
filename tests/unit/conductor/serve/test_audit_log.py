"""``audit.jsonl``: what is said of whom, how it is bounded, and what a withdrawn key leaves."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from conductor_bench import hello, submit
from typer.testing import CliRunner
from unit.conductor.ops_bench import running_hub, serving
from waiting import PATIENCE_S

import conductor.serve.audit
import conductor.serve.shell
from conductor.cli import app
from conductor.serve.audit import ALL_LINES_MAX, FILE_NAME, LINES_MAX, OLD_NAME, PERIOD_S, Audit
from schemas import SCHEMA_VERSION as V
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Control, Reply, Request, StatusRequest, Stop
from schemas.wire.rpc_routes import COMMAND_BYTES_MAX, route_key
from twin.fabric.front.messages import FrontEvent
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import read_certificate
from twin.fabric.keys.revoked import read_revoked


def lines(folder: Path, name: str = FILE_NAME) -> list[dict[str, Any]]:
    path = folder / name
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


class Clock:
    now_s = 1e9

    def __call__(self) -> float:
        return self.now_s


def test_a_line_says_when_who_and_why(tmp_path: Path) -> None:
    audit = Audit(tmp_path, Clock())
    audit.heard(FrontEvent("opened", "10.0.0.7", "submitter", "a1"))
    audit.heard(FrontEvent("opened", "10.0.0.8", "viewer", "b2"))
    audit.asked(topics.RPC_SUBMIT.key, submit(), "")
    audit.asked(topics.RPC_ADMIN.key, Stop(v=V), "")
    audit.asked(topics.RPC_STATUS.key, StatusRequest(v=V), "")
    audit.heard(FrontEvent("closed", "10.0.0.7", "submitter", "a1"))
    audit.asked(topics.RPC_SUBMIT.key, submit(), "a folder is missing")
    audit.heard(FrontEvent("refused", "10.0.0.9", reason="it showed no key"))
    opened, viewer, command, stopped, closed, refused_command, refused = lines(tmp_path)
    assert opened == {
        "time": "2001-09-09T01:46:40.000+00:00",
        "what": "opened",
        "peer": "10.0.0.7",
        "role": "submitter",
        "key": "a1",
    }
    assert (viewer["key"], closed["what"]) == ("b2", "closed")
    assert (command["what"], command["said"], command["keys"]) == (
        "command",
        "submit alpha",
        ["a1"],
    )
    assert (stopped["said"], "keys" in stopped) == ("stop", False), "nobody who may is connected"
    assert refused_command["said"] == "submit alpha: a folder is missing"
    assert (refused["peer"], refused["said"]) == ("10.0.0.9", "it showed no key")


def test_a_flood_is_counted_and_leaves_room_for_others(tmp_path: Path) -> None:
    clock = Clock()
    audit = Audit(tmp_path, clock)
    for _ in range(LINES_MAX + 4312):
        audit.heard(FrontEvent("refused", "10.0.0.9", reason="it does not speak TLS"))
    audit.heard(FrontEvent("refused", "10.0.0.1", reason="it showed no key"))
    assert len(lines(tmp_path)) == LINES_MAX + 1
    clock.now_s += PERIOD_S
    audit.heard(FrontEvent("refused", "10.0.0.9", reason="it does not speak TLS"))
    *_, more, last = lines(tmp_path)
    assert (more["what"], more["said"], more["count"], more["peer"]) == (
        *("more", "and 4,312 more: refused", 4312),
        "10.0.0.9",
    )
    assert last["what"] == "refused"


def test_many_addresses_are_bounded_too(tmp_path: Path) -> None:
    audit = Audit(tmp_path, Clock())
    for number in range(2 * ALL_LINES_MAX):
        audit.heard(FrontEvent("refused", f"10.0.{number // 256}.{number % 256}", reason="no key"))
    assert len(lines(tmp_path)) == ALL_LINES_MAX
    audit.close()
    counts = [line["count"] for line in lines(tmp_path)[ALL_LINES_MAX:]]
    assert sum(counts) == ALL_LINES_MAX


def test_a_full_file_makes_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.serve.audit, "FILE_BYTES_MAX", 300)
    audit = Audit(tmp_path, Clock())
    for _ in range(10):
        audit.heard(FrontEvent("opened", "10.0.0.7", "worker", "a1"))
    assert 0 < len(lines(tmp_path, OLD_NAME)) < 10
    assert all(path.stat().st_size < 600 for path in tmp_path.iterdir())
    assert (tmp_path / OLD_NAME).stat().st_mode & 0o077 == 0, "for its owner"


def test_what_cannot_be_written_stops_nobody(tmp_path: Path) -> None:
    audit = Audit(tmp_path / "missing", Clock())
    audit.heard(FrontEvent("opened", "10.0.0.7", "worker", "a1"))
    (tmp_path / "missing").mkdir()
    audit.heard(FrontEvent("closed", "10.0.0.7", "worker", "a1"))
    assert [line["what"] for line in lines(tmp_path / "missing")] == ["closed"]


def test_commands_and_refusals_of_a_conductor_are_there(tmp_path: Path) -> None:
    state = tmp_path / "state"
    with running_hub() as hub, serving(state, hub):
        bus = hub.open()

        def ask(request: Request) -> Reply:
            return decode(
                bus.request(route_key(request), encode(request), PATIENCE_S) or b"", Reply
            )

        ask(submit())
        ask(hello())
        ask(Control(v=V, action="pause", campaign="alpha\nforged line"))
        bus.request(topics.RPC_STATUS.key, bytes(COMMAND_BYTES_MAX + 1), PATIENCE_S)
        bus.request(topics.RPC_STATUS.key, encode(Stop(v=V)), PATIENCE_S)
    said = [(line["what"], line["said"]) for line in lines(state)]
    assert said[0] == ("command", "submit alpha")
    assert said[1][1].startswith("pause alpha\\nforged line: ")
    assert said[2:] == [
        (
            "refused",
            f"message of {COMMAND_BYTES_MAX + 1} bytes, at most {COMMAND_BYTES_MAX} are accepted",
        ),
        ("refused", "Stop came on conductor/rpc/status; send it to conductor/rpc/admin"),
    ]


def test_submissions_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few, because one more is let in every so often: a slow machine must not be let in all."""
    monkeypatch.setattr(conductor.serve.shell, "SUBMISSIONS_PER_MINUTE", 6)
    with running_hub() as hub, serving(tmp_path / "state", hub):
        bus = hub.open()
        replies = [
            decode(bus.request(topics.RPC_SUBMIT.key, encode(submit()), PATIENCE_S) or b"", Reply)
            for _ in range(11)
        ]
    refused = [reply.error for reply in replies if reply.error]
    assert 1 <= len(refused) <= 5
    assert set(refused) == {"more than 6 submissions in a minute; submit it later"}


def run(*arguments: str) -> tuple[int, str]:
    found = CliRunner().invoke(app, list(arguments))
    return found.exit_code, found.stdout + str(found.exception or "")


def test_a_key_is_withdrawn_by_its_file_or_its_number(tmp_path: Path) -> None:
    keys = make_keys(tmp_path / "keys")
    worker, viewer = (
        read_certificate(keys / f"{role}.key").serial_number for role in ("worker", "viewer")
    )
    code, said = run("revoke", str(keys / "worker.key"), "--key", str(keys))
    assert (code, said.startswith(f"withdrew key {worker:x}; ")) == (0, True), said
    code, said = run("revoke", f"{viewer:X}", "--key", str(keys))
    assert (code, said.startswith(f"withdrew key {viewer:x}; ")) == (0, True), said
    assert read_revoked(keys) == {worker, viewer}
    code, said = run("revoke", f"{viewer:x}", "--key", str(keys))
    assert (code, "was withdrawn already" in said) == (0, True)


def test_what_is_no_key_of_the_fabric_is_not_withdrawn(tmp_path: Path) -> None:
    keys, other = make_keys(tmp_path / "keys"), make_keys(tmp_path / "other")
    (tmp_path / "note").write_text("no key")
    for given, words in (
        (str(other / "worker.key"), "of another fabric"),
        (str(tmp_path / "note"), "it holds no certificate"),
        ("nonsense", "no such key file, and no serial number"),
    ):
        _, said = run("revoke", given, "--key", str(keys))
        assert words in said, said
    assert read_revoked(keys) == frozenset()


def test_how_many_sessions_were_cut_is_read_from_the_log(tmp_path: Path) -> None:
    audit = Audit(tmp_path)
    audit.heard(FrontEvent("cut", "", "worker", "a1", "withdrawn", 7))
    wait = conductor.serve.audit.await_cut(tmp_path, 0xA1)
    threading.Timer(
        0.2, audit.heard, [FrontEvent("cut", "", "worker", "a1", "withdrawn", 3)]
    ).start()
    assert wait() == 3, "not that of another time"
