"""A conductor that was frozen itself must not take it out on its workers."""

from __future__ import annotations

from pathlib import Path

import pytest
from conductor_bench import CONFIG, S, hello, next_of, submit
from unit.conductor.ops_bench import running_hub, serving

import conductor.serve.shell
from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply


def test_leases_get_a_full_time_to_live_after_waking_up(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    engine = ConductorEngine(journal, CONFIG, 0)
    engine.turn([IncomingRequest(encode(request), S) for request in (submit(), hello())])
    turn = engine.turn([IncomingRequest(encode(next_of(worker="w1", seq=1, k=1)), S)])
    (lease,) = decode(turn.replies[0] or b"", Reply).leases
    engine.woke(100 * S)
    ttl_ns = CONFIG.ttl_ns
    engine.tick(100 * S + ttl_ns - 1)
    assert lease.token in engine.state.leases
    engine.tick(100 * S + ttl_ns)
    assert lease.token not in engine.state.leases
    journal.close()


def test_the_loop_notices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Every turn counts as frozen: leases never expire, and the log says why."""
    monkeypatch.setattr(conductor.serve.shell, "FROZEN_MIN_S", -1.0)
    monkeypatch.setattr(conductor.serve.shell, "IDLE_S", 0.01)
    with running_hub() as hub, serving(tmp_path, hub, config=Config(ttl_ns=0)) as served:
        served.request(submit())
    assert "stood still for" in caplog.text
