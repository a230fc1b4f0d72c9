"""Recordings in a result store: who may name one, of what, and what becomes of it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import msgpack
import pytest
from conductor_bench import CONFIG, Bench, V, hello, result, secret, submit

from conductor.core.facts import RecordingStored
from conductor.core.fold import fold
from conductor.core.snapshot import take
from conductor.records.outcomes import encode_campaign, outcomes_of
from schemas.files.recording import RECORDING_BYTES_MAX, RecordingObject
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Lease, Recorded, Request

STORED = RecordingObject("ab" * 32, 4711, True)
WITH_STORE = replace(CONFIG, store="s3://results/run")


def recorded(lease: Lease, worker: str = "w1", **fields: Any) -> Recorded:
    values: dict[str, Any] = {
        "campaign": lease.case.variation.campaign,
        "case": lease.case.id,
        "token": lease.token,
        "recording": STORED,
        "session": secret(worker),
    }
    return Recorded(v=V, worker=worker, **(values | fields))


def begun(config: Any = WITH_STORE) -> Bench:
    """A conductor with four cases and two workers."""
    bench = Bench(config)
    bench.ask(submit(cases=4))
    for worker in ("w1", "w2"):
        bench.ask(hello(worker))
    return bench


def committed(bench: Bench, worker: str = "w1") -> Lease:
    """A case that ``worker`` has committed."""
    (lease,) = bench.lease(worker)
    bench.next(worker, 0, results=[result(lease)])
    return lease


def test_a_recording_is_a_fact_of_its_case_and_stands_in_the_outcomes() -> None:
    bench = begun()
    lease = committed(bench)
    before = encode_campaign(bench.state.campaigns["alpha"])
    assert not bench.ask(recorded(lease)).error
    (fact,) = bench.facts(RecordingStored)
    assert (fact.case, fact.token, fact.recording) == (lease.case.id, lease.token, STORED)
    shown = json.loads(encode_campaign(bench.state.campaigns["alpha"]))["cases"]
    assert shown[lease.case.id]["recording"] == {
        "sha256": "ab" * 32,
        "size": 4711,
        "complete": True,
    }
    assert outcomes_of(bench.state.campaigns["alpha"]).cases[lease.case.id].recording == STORED
    assert b"recording" not in before, "files of runs without a store are as ever"


def test_a_restart_and_a_snapshot_know_it() -> None:
    bench = begun()
    lease = committed(bench)
    bench.ask(recorded(lease))
    bench.restart()
    assert bench.state.campaigns["alpha"].cases[lease.case.id].recording == STORED
    alone = fold([take(bench.state)], bench.config)
    assert alone.campaigns["alpha"].cases[lease.case.id].recording == STORED
    assert not bench.ask(recorded(lease)).error, "it is said again when the answer was lost"
    assert len(bench.facts(RecordingStored)) == 1


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"token": 1 << 40}, "token 1099511627776 is not one that worker w1 has committed"),
        ({"case": "repeat_3"}, "not one that worker w1 has committed"),
        ({"case": "../../etc"}, "not one that worker w1 has committed"),
        ({"campaign": "beta"}, "of campaign 'beta'"),
        ({"worker": "w2", "session": secret("w2")}, "not one that worker w2 has committed"),
        ({"session": secret("w2")}, "secret is not that of the process"),
        ({"session": b"", "worker": "w9"}, "unknown worker"),
    ],
)
def test_what_a_worker_has_not_committed_is_not_its_to_name(
    change: dict[str, Any], line: str
) -> None:
    bench = begun()
    lease = committed(bench)
    committed(bench, "w2")
    assert line in bench.ask(recorded(lease, **change)).error
    assert not bench.facts(RecordingStored)


def test_a_case_that_still_runs_has_none() -> None:
    bench = begun()
    (lease,) = bench.lease("w1")
    assert "has committed" in bench.ask(recorded(lease)).error
    bench.next("w1", 0, results=[result(lease)])
    assert not bench.ask(recorded(lease)).error


def test_the_first_recording_counts() -> None:
    bench = begun()
    lease = committed(bench)
    bench.ask(recorded(lease))
    other = RecordingObject("cd" * 32, 1, True)
    assert "has another recording already" in bench.ask(recorded(lease, recording=other)).error
    assert bench.state.campaigns["alpha"].cases[lease.case.id].recording == STORED


def test_a_late_result_brings_no_recording_into_the_case() -> None:
    bench = begun(replace(WITH_STORE, ttl_ns=1_000_000_000))
    (lost,) = bench.lease("w1")
    bench.now_ns += 10_000_000_000
    bench.tick()
    (again,) = bench.lease("w2")
    assert again.case.id == lost.case.id
    bench.next("w2", 0, results=[result(again)])
    assert "has committed" in bench.ask(recorded(lost)).error, "its token is w1's, and lost"
    bench.next("w1", 0, results=[result(lost)])
    assert "has committed" in bench.ask(recorded(lost)).error
    assert not bench.ask(recorded(again, "w2")).error


def test_without_a_store_nothing_is_kept() -> None:
    bench = begun(CONFIG)
    lease = committed(bench)
    assert "has no result store" in bench.ask(recorded(lease)).error
    assert not bench.facts(RecordingStored)


@pytest.mark.parametrize(
    "recording",
    [
        {"sha256": "../../" + "a" * 58, "size": 1, "complete": True},
        {"sha256": "AB" * 32, "size": 1, "complete": True},
        {"sha256": "ab" * 32 + "\n", "size": 1, "complete": True},
        {"sha256": "ab" * 32, "size": 0, "complete": True},
        {"sha256": "ab" * 32, "size": RECORDING_BYTES_MAX + 1, "complete": True},
        {"sha256": "ab" * 32, "size": 100 << 30, "complete": True},
        {"sha256": "ab" * 32, "size": 1},
    ],
)
def test_what_names_no_object_is_refused_while_it_is_decoded(recording: dict[str, Any]) -> None:
    bench = begun()
    message = msgpack.unpackb(encode(recorded(committed(bench))))
    with pytest.raises(WireError):
        decode(msgpack.packb({**message, "recording": recording}), Request)
    assert decode(msgpack.packb(message), Request) == message_of(message)


def message_of(message: dict[str, Any]) -> Recorded:
    """The message with the recording that it had."""
    fields = {key: value for key, value in message.items() if key not in ("verb", "recording")}
    return Recorded(**fields, recording=RecordingObject(**message["recording"]))
