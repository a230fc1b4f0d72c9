"""What a simulator says while its engine is built."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from twin.rig import pipe
from twin.rig.pipe import Building, Built, Unpacker, Upstream, Upward


@contextmanager
def pipes() -> Iterator[tuple[Upstream, Iterator[object]]]:
    """Where a simulator writes, and what its worker gets of it."""
    read, write = os.pipe()

    def messages() -> Iterator[object]:
        unpacker = Unpacker(Upward)
        while data := os.read(read, 65536):
            yield from unpacker.feed(data)

    try:
        with os.fdopen(write, "wb", buffering=0) as stream:
            yield Upstream(stream), messages()
    finally:
        os.close(read)


def test_a_worker_hears_of_a_long_build_until_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipe, "BUILD_BEAT_S", 0.01)
    with pipes() as (upward, messages):
        with upward.building():
            assert [next(messages) for _ in range(3)] == [Building()] * 3
        upward.send(Built("none"))
        assert {type(message) for message in iter(messages.__next__, Built("none"))} <= {Building}


def test_a_build_that_never_ends_is_not_vouched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipe, "BUILD_BEAT_S", 0.01)
    monkeypatch.setattr(pipe, "BUILD_MAX_S", 0.03)
    with pipes() as (upward, messages):
        with upward.building():
            for beats in [t for t in threading.enumerate() if t.name == "building"]:
                beats.join()
            upward.send(Built("none"))
        assert [next(messages) for _ in range(4)] == [*[Building()] * 3, Built("none")]


def test_a_short_build_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipe, "BUILD_BEAT_S", 3600.0)
    with pipes() as (upward, messages):
        with upward.building():
            pass
        upward.send(Built("none"))
        assert next(messages) == Built("none")
