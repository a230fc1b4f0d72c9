"""Requests at and beyond their bounds: refused in a line, and the conductor keeps its state."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from conductor_bench import CONFIG, S, campaign, hello, result, shown, submit

import conductor.core.admit
import conductor.serve.engine
import schemas.points
from conductor.core.admit import CASES_HELD_MAX, OUT_CHARS_MAX, PART_BYTES_MAX, admit
from conductor.core.durations import CaseLengths
from conductor.core.facts import Replied, WorkerLeft
from conductor.core.fold import apply
from conductor.core.state import Config, State
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION as V
from schemas.plan import CASES_MAX, parse_campaign
from schemas.validation import MISTAKES_MAX
from schemas.wire.bounds import COUNT_MAX, ENTRIES_MAX, INT64_MAX, TICKS_MAX
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Next, Reply, Request, Submit

TOKEN_MAX = 10**18 - 1
RESULT = {"campaign": "c", "case": "a", "token": 1, "outcome": "verdict", "verdict": "pass"}
ENDED = {"campaign": "c", "case": "a", "token": 1, "reason": "crash"}
NEXT: dict[str, Any] = {"verb": "next", "worker": "w1", "seq": 1, "k": 0}
BEAT: dict[str, Any] = {"verb": "beat", "worker": "w1", "held": {}}


def _next(**fields: Any) -> dict[str, Any]:
    return {**NEXT, **fields}


def _beat(**fields: Any) -> dict[str, Any]:
    return {**BEAT, **fields}


def _touched(**fields: Any) -> dict[str, Any]:
    return _beat(touched={"1": {"tick": 0, "what": "pause", "changes": 0, **fields}})


def _hello(**fields: Any) -> dict[str, Any]:
    return {"verb": "hello", **msgspec.structs.asdict(hello()), **fields}


BOUNDED: list[tuple[Callable[[int], dict[str, Any]], int, int]] = [
    (lambda n: _next(seq=n), 0, INT64_MAX),
    (lambda n: _next(k=n), 0, COUNT_MAX),
    (lambda n: _next(held=[n]), 0, TOKEN_MAX),
    (lambda n: _next(results=[{**RESULT, "token": n}]), 0, TOKEN_MAX),
    (lambda n: _next(results=[{**RESULT, "scalars": {"x": n}}]), -INT64_MAX - 1, INT64_MAX),
    (lambda n: _next(ended=[{**ENDED, "token": n}]), 0, TOKEN_MAX),
    (lambda n: _beat(held={"1": n}), -1, TICKS_MAX),
    (lambda n: _beat(held={str(n): 1}), 0, TOKEN_MAX),
    (lambda n: _touched(tick=n), 0, TICKS_MAX),
    (lambda n: _touched(changes=n), 0, COUNT_MAX),
    (lambda n: _hello(pid=n), 0, COUNT_MAX),
    (lambda n: _hello(slots=n), 0, COUNT_MAX),
    (lambda n: _hello(memory_bytes=n), 0, INT64_MAX),
    (
        lambda n: {"verb": "submit", "campaign": {}, "priority": n},
        -COUNT_MAX,
        COUNT_MAX,
    ),
]


@pytest.mark.parametrize(("made", "least", "most"), BOUNDED)
def test_numbers_beyond_their_bounds_never_reach_the_core(
    made: Callable[[int], dict[str, Any]], least: int, most: int
) -> None:
    for number in (least, most):
        assert decode(msgpack.packb({"v": V, **made(number)}), Request)
    for number in (least - 1, most + 1):
        if not -(2**63) <= number < 2**64:
            continue  # no MessagePack number
        with pytest.raises(WireError) as caught:
            decode(msgpack.packb({"v": V, **made(number)}), Request)
        assert str(caught.value).startswith("not a valid message: ")
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("token", ["", "-1", "x", "1.0", "٣", "1" * 19, "1" * 20, "1\n"])
def test_what_is_no_token_is_refused(token: str) -> None:
    for fields in ({"held": {token: 0}}, {"touched": {token: {}}}):
        with pytest.raises(WireError, match="not a valid message"):
            decode(msgpack.packb({"v": V, **_beat(**fields)}), Request)


def test_lists_have_an_end() -> None:
    for name in ("held", "results", "ended"):
        with pytest.raises(WireError, match=f"length <= {ENTRIES_MAX}"):
            decode(msgpack.packb({"v": V, **_next(**{name: [1] * (ENTRIES_MAX + 1)})}), Request)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    opened = Journal(tmp_path)
    yield opened
    opened.close()


def test_a_fact_that_cannot_be_stored_leaves_no_transaction_open(journal: Journal) -> None:
    huge = Replied(worker="w1", seq=2**63, reply=Reply(v=V, epoch=1))
    unknown = Replied(worker=object(), seq=1, reply=Reply(v=V, epoch=1))  # type: ignore[arg-type]
    for fact, error in ((huge, OverflowError), (unknown, Exception)):
        with pytest.raises(error):
            journal.append([WorkerLeft(worker="w0"), fact])
        journal.append([])
        journal.probe()
    journal.append([WorkerLeft(worker="w2")])
    assert list(journal.fold()) == [WorkerLeft(worker="w2")], "nothing of the failed calls"


@pytest.fixture
def engine(journal: Journal, tmp_path: Path) -> ConductorEngine:
    folders = Folders(tmp_path)
    config = Config(folder=str(tmp_path))
    engine = ConductorEngine(
        journal, config, 0, lambda request: folders.check(engine.state, request)
    )
    assert [reply.error for reply in _ask(engine, submit(), hello())] == ["", ""]
    return engine


def _ask(engine: ConductorEngine, *requests: Request) -> list[Reply]:
    turn = engine.turn([IncomingRequest(encode(shown(request)), S) for request in requests])
    return [decode(reply or b"", Reply) for reply in turn.replies]


def test_no_request_makes_the_conductor_read_its_journal_again(engine: ConductorEngine) -> None:
    """Reading it takes seconds with many cases, and nobody is served meanwhile."""
    state = engine.state
    (reply,) = _ask(engine, Next(v=V, worker="w1", seq=1, k=1))
    lease = reply.leases[0]
    bad = [
        Next(v=V, worker="w1", seq=2**63, k=1),
        Next(v=V, worker="w1", seq=2, k=0, held=[2**63]),
        Next(v=V, worker="w1", seq=2, k=0, results=[result(lease, token=2**64 - 1)]),
        *(submit("other", out=out) for out in OUTS),
    ]
    requests = [bad[0], hello("w2"), *bad[1:], hello("w3")]
    replies = _ask(engine, *requests)
    for request, reply in zip(requests, replies, strict=True):
        assert bool(reply.error) == (request in bad), request
        assert "internal" not in reply.error
        assert len(reply.error.splitlines()) <= 1
        assert reply.error.isprintable()
    assert engine.state is state
    assert engine.counters.faults == 0
    assert not engine.storage_error
    (reply,) = _ask(engine, Next(v=V, worker="w1", seq=2, k=0, results=[result(lease)]))
    assert (reply.error, reply.acks, reply.fenced) == ("", [lease.token], [])


OUTS = (
    "/tmp/" + "x" * (PART_BYTES_MAX + 1),
    "/tmp/" + "ü" * (PART_BYTES_MAX // 2 + 1),
    "/tmp" + "/x" * OUT_CHARS_MAX,
    "/tmp" + f"/{'😀' * 60}" * 15,
    "/tmp/a\0b",
    "/proc/self/cmdline/x",
    "/dev/null",
)


@pytest.mark.parametrize("out", OUTS[:4])
def test_a_path_that_no_disk_takes_is_refused_before_it_is_tried(out: str) -> None:
    fact, (error,) = admit(State(config=CONFIG), submit(out=out))
    assert fact is None
    assert error.startswith("alpha: out folder '/tmp")
    assert "allowed: " in error
    longest = "/" + "/".join(["x" * PART_BYTES_MAX] * 3)
    fact, errors = admit(State(config=CONFIG), submit(out=longest))
    assert not errors


def test_a_mistake_of_ours_before_anything_changed_costs_no_reading(
    engine: ConductorEngine, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def mistaken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(conductor.serve.engine, "decide", mistaken)
    state = engine.state
    with caplog.at_level(logging.CRITICAL):
        first, second = _ask(engine, hello("w2"), hello("w3"))
    assert first.error == second.error == "internal error of the conductor; see its log"
    assert engine.state is state
    assert engine.counters.faults == 2


class _Full:
    """Enough of a campaign to be counted."""

    cases = range(CASES_HELD_MAX - 10)
    out = "/nowhere"
    lengths = CaseLengths()


MATRIX = {"repeat": list(range(5)), "weather": ["clear", "cloudy"]}


def _full() -> State:
    state = State(config=CONFIG)
    state.campaigns = {"old": _Full()}  # type: ignore[dict-item]
    return state


@pytest.mark.parametrize(
    ("given", "count"),
    [
        ({"matrix": {"repeat": list(range(11))}}, 11),
        ({"matrix": MATRIX, "cases": [{}]}, 11),
        ({"cases": [{"repeat": i} for i in range(12)]}, 12),
        ({"matrix": {"repeat": list(range(11))}, "scenario": {"nonsense": 1}}, 11),
    ],
)
def test_too_many_cases_are_refused_before_they_are_expanded(
    given: dict[str, Any], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def expanded(*_: object) -> None:
        raise AssertionError("it takes 4 s for a hundred thousand cases")

    monkeypatch.setattr(conductor.core.admit, "parse_plan", expanded)
    fact, (error,) = admit(_full(), Submit(V, {"campaign": "c", **given}))
    assert fact is None
    assert f"{count} more given, at most {CASES_HELD_MAX}" in error


@pytest.mark.parametrize(
    "given",
    [
        {"matrix": MATRIX},
        {"matrix": {"repeat": 3}},
        {"matrix": 3, "cases": 4},
        {"matrix": [1] * 20},
        {"matrix": {"repeat": list(range(CASES_MAX + 1))}},
    ],
)
def test_what_fits_or_is_wrong_is_looked_at_as_always(given: dict[str, Any]) -> None:
    fact, errors = admit(_full(), Submit(V, {"campaign": "c", "simulator": "noop", **given}))
    assert (fact is not None) == (given["matrix"] == MATRIX)
    assert not any("more given" in error for error in errors)


def test_a_known_campaign_goes_on_however_full_the_conductor_is() -> None:
    state = _full()
    fact, _ = admit(State(config=CONFIG), submit(cases=4))
    assert fact is not None
    apply(state, fact)
    assert admit(state, submit(cases=4)) == (None, [])


def test_mistakes_of_many_cases_come_to_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = []
    value_of = schemas.points.value_of

    def counted(*given: Any) -> Any:
        looked.append(1)
        return value_of(*given)

    monkeypatch.setattr(schemas.points, "value_of", counted)
    _, mistakes = parse_campaign(
        {**campaign(cases=1), "cases": [{"repeat": -i} for i in range(1, 9000)]}
    )
    assert len(mistakes) == MISTAKES_MAX + 1
    assert mistakes[-1].message == "and more; correct these first"
    assert len(looked) < 5 * MISTAKES_MAX, "three axes of each case"
