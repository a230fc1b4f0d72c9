"""Requests of every type with whatever fits on the wire: answered, and the journal goes on.

A real engine over a real journal gets them in groups, as the shell hands them over. What none of
them may do: raise, be answered by an internal error, make the conductor fold its journal again,
leave a transaction open, or move what belongs to the one honest worker.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from conductor_bench import S, campaign, hello, next_of, result, secret, submit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from conductor.core.facts import Committed
from conductor.core.fold import fold
from conductor.core.invariants import check
from conductor.core.session import folder_for
from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Reply
from schemas.wire.delivery import Delivery

WORKER = "w1"
"""The honest one."""
NUMBERS = st.one_of(
    st.sampled_from([0, 1, -1, 2**31 - 1, 2**31, 2**32 + 1, 2**32 + 2, 10**18 - 1, 10**18]),
    st.sampled_from([2**63 - 1, 2**63, 2**64 - 1, -(2**63)]),
    st.integers(-(2**63), 2**64 - 1),
)
WORDS = st.one_of(
    st.sampled_from([WORKER, "w2", "alpha", "repeat_0", "repeat_1", "", "a/b", "..", "x" * 300]),
    st.sampled_from([f"cases/repeat_{n}/attempt-{m}" for n in (0, 1) for m in (1, 2)]),
    st.sampled_from(
        ["/tmp", "/" + "y" * 256, "/proc/self/x", "\0", "\n\x1b[2J", "verdict", "pass"]
    ),
    st.text(max_size=12),
)
BYTES = st.one_of(st.sampled_from([b"", bytes(32), secret("w2")]), st.binary(max_size=70))
ANYTHING = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.floats(), WORDS, BYTES),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.one_of(WORDS, NUMBERS), inner, max_size=3)
    ),
    max_leaves=6,
)


def maps(**fields: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Each field is there or not, and now and then something else entirely."""
    odd = {name: st.one_of(fit, fit, fit, fit, ANYTHING) for name, fit in fields.items()}
    return st.fixed_dictionaries({}, optional=odd)


def lists(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Any]]:
    return st.lists(inner, max_size=3)


TOKENS = st.one_of(st.sampled_from([2**32 + 1, 2**32 + 2, 2**32 + 3]), NUMBERS)
NAMES = {"campaign": st.just("alpha"), "case": st.sampled_from(["repeat_0", "repeat_1", "x"])}
RESULT = st.builds(
    lambda base, odd: {**base, **odd},
    st.fixed_dictionaries(
        {
            **NAMES,
            "token": TOKENS,
            "outcome": st.sampled_from(["verdict", "failed"]),
            "verdict": st.sampled_from(["pass", "collision", ""]),
        }
    ),
    maps(
        attempt_dir=WORDS,
        kpi_sha256=WORDS,
        scalars=st.dictionaries(WORDS, st.one_of(NUMBERS, st.floats(), st.none()), max_size=2),
        reasons=lists(WORDS),
        wall_s=st.floats(),
        perception=maps(runtime=WORDS, frames=NUMBERS, wall_s=st.floats()),
    ),
)
ENDED = maps(**NAMES, token=TOKENS, reason=st.sampled_from(["crash", "suspect", "lost"]))
TOUCH = maps(tick=NUMBERS, what=WORDS, changes=NUMBERS)
SEALED = st.fixed_dictionaries(
    {
        "token": TOKENS,
        "worker": WORDS,
        "result": st.one_of(RESULT.map(msgpack.packb), BYTES),
        "seal": BYTES,
    }
)
PLAIN = {"worker": st.sampled_from(["w2", "w2", WORKER, "w3"])}
OWN = {"worker": "w2", "session": secret("w2")}
HELLO = msgspec.structs.asdict(hello("w4"))
CASE = {"campaign": "alpha", "case": "repeat_1"}
OTHER = {**campaign("beta", 2), "simulator": "noop"}
NEXT = {**OWN, "seq": 1, "k": 1}
TEXTS = st.one_of(TOKENS.map(str), WORDS)
REQUESTS = st.one_of(
    maps(
        **PLAIN,
        host=WORDS,
        pid=NUMBERS,
        device_class=WORDS,
        software=st.sampled_from(["f00d", "other"]),
        slots=NUMBERS,
        walltime_end_s=st.floats(),
        memory_bytes=NUMBERS,
        tags=lists(WORDS),
        share=maps(stretch=NUMBERS, stretches=NUMBERS, device=NUMBERS, devices=NUMBERS),
        lacks=st.dictionaries(WORDS, WORDS, max_size=2),
        session=BYTES,
    ).map(lambda fields: {**HELLO, **fields, "verb": "hello"}),
    maps(
        **PLAIN,
        seq=NUMBERS,
        k=st.one_of(st.integers(0, 3), NUMBERS),
        rig=WORDS,
        results=lists(RESULT),
        ended=lists(ENDED),
        held=lists(TOKENS),
        remaining_s=st.floats(),
        session=BYTES,
        sealed=lists(SEALED),
    ).map(lambda fields: {**NEXT, **fields, "verb": "next"}),
    maps(
        **PLAIN,
        held=st.dictionaries(TEXTS, NUMBERS, max_size=3),
        touched=st.dictionaries(TEXTS, TOUCH, max_size=2),
        session=BYTES,
    ).map(lambda fields: {"held": {}, **OWN, **fields, "verb": "beat"}),
    maps(**PLAIN, detail=WORDS, session=BYTES).map(lambda fields: {**OWN, **fields, "verb": "bye"}),
    maps(
        campaign=st.one_of(
            st.dictionaries(WORDS, ANYTHING, max_size=3),
            maps(
                campaign=WORDS,
                matrix=st.dictionaries(WORDS, ANYTHING, max_size=2),
                cases=lists(ANYTHING),
                seed=NUMBERS,
            ),
            st.builds(
                lambda name, numbers: (
                    campaign(name, 1) | {"matrix": {"repeat": numbers}, "simulator": "noop"}
                ),
                st.sampled_from(["beta", "gamma"]),
                st.one_of(st.just([1, 2]), st.lists(NUMBERS, max_size=3)),
            ),
        ),
        out=st.one_of(st.just(""), st.just(""), WORDS),
        software=WORDS,
        priority=NUMBERS,
    ).map(lambda fields: {"campaign": OTHER, **fields, "verb": "submit"}),
    maps(
        action=st.sampled_from(["pause", "resume", "retry"]),
        campaign=st.one_of(st.just("alpha"), WORDS),
        case=st.one_of(st.just("repeat_1"), WORDS),
        worker=WORDS,
    ).map(lambda f: {"action": "pause", **CASE, **f, "verb": "control"}),
    maps(campaign=WORDS, case=WORDS).map(
        lambda f: {"campaign": "alpha", "case": "repeat_0", **f, "verb": "explain"}
    ),
    maps(running=st.booleans()).map(lambda f: {**f, "verb": "status"}),
)
DELIVERIES = maps(
    verb=st.sampled_from(["seen", "attempt"]),
    campaign=st.sampled_from(["alpha", "beta"]),
    case=WORDS,
    attempt=NUMBERS,
    kpi=BYTES,
    log=BYTES,
    sha256=WORDS,
    worker=WORDS,
    session=BYTES,
)


TAKEN: Counter[str] = Counter()
"""Requests without an error, by verb."""


def packed(value: Any) -> bytes:
    data: bytes = msgpack.packb({"v": V, **value})
    return data


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
@given(
    groups=st.lists(st.lists(REQUESTS, min_size=1, max_size=5), min_size=1, max_size=4),
    files=lists(DELIVERIES),
)
def thrown(groups: list[list[dict[str, Any]]], files: list[dict[str, Any]]) -> None:
    with tempfile.TemporaryDirectory() as name:
        journal = Journal(Path(name))
        try:
            _tried(journal, Folders(Path(name)), name, groups, files)
        finally:
            journal.close()


@pytest.mark.slow
def test_no_request_raises_or_keeps_the_journal_in_a_transaction() -> None:
    TAKEN.clear()
    thrown()
    verbs = ("hello", "next", "beat", "bye", "submit", "control", "explain", "status")
    assert min(TAKEN[verb] for verb in verbs) >= 3, f"hardly anything was taken: {TAKEN}"


def _tried(
    journal: Journal,
    folders: Folders,
    name: str,
    groups: list[list[dict[str, Any]]],
    files: list[dict[str, Any]],
) -> None:
    config = Config(folder=name, speculate=False)
    engine = ConductorEngine(
        journal, config, 0, lambda request: folders.check(engine.state, request)
    )

    def ask(*payloads: bytes) -> list[Reply]:
        turn = engine.turn([IncomingRequest(payload, S) for payload in payloads])
        assert engine.counters.faults == 0
        assert not engine.storage_error
        return [decode(reply or b"", Reply) for reply in turn.replies]

    assert not any(r.error for r in ask(*map(encode, (submit(cases=2), hello(), hello("w2")))))
    (mine,) = ask(encode(next_of(WORKER, 1, 1)))
    (lease,) = mine.leases
    state = engine.state
    for group in groups:
        replies = ask(*map(packed, group))
        assert len(replies) == len(group)
        TAKEN.update(
            str(asked["verb"]) for asked, told in zip(group, replies, strict=True) if not told.error
        )
        assert all("internal" not in reply.error for reply in replies)
        check(engine.state)
    assert engine.state is state, "the journal was folded again"
    for message in files:
        try:
            found: Delivery = decode(packed(message), Delivery)
        except WireError:
            continue
        assert folder_for(engine.state, found)[1], "nobody here has a secret to show"
    # The honest worker's case is as it was, and its result is taken.
    journal.append([])
    (done,) = ask(encode(next_of(WORKER, 2, 0, results=[result(lease)])))
    assert (done.error, done.acks, done.fenced) == ("", [lease.token], [])
    (verdict,) = [
        fact.result
        for fact in journal.fold()
        if isinstance(fact, Committed) and fact.result.case == lease.case.id
    ]
    assert verdict == result(lease)
    assert fold(journal.fold(), config) == engine.state
