"""Events: who comes back is sent what it missed, or told that it is gone."""

import json
import threading

import pytest
from waiting import PATIENCE_S

from viewer.console.stream import FOLLOWERS_MAX, EventStream, sse


def fields(event):
    return [line.partition(b": ")[::2] for line in event.text.splitlines() if line]


def test_events_are_numbered_and_followed():
    stream = EventStream("e")
    assert stream.after("") == (0, False)
    stream.put("table", {"run": "a\nevent: evil", "rows": {}})
    (event,) = stream.wait(0, 0)
    assert [name for name, _ in fields(event)] == [b"id", b"event", b"data"]
    assert json.loads(fields(event)[2][1])["run"] == "a\nevent: evil", "no line of its own"
    assert fields(event)[0][1] == b"e-1"
    assert stream.wait(1, 0) == []


def test_who_comes_back_misses_nothing():
    stream = EventStream("e")
    for number in range(5):
        stream.put("log", number)
    assert stream.after("e-2") == (2, False)
    assert [event.number for event in stream.wait(2, 0)] == [3, 4, 5]
    assert stream.after("e-5") == (5, False)


@pytest.mark.parametrize(
    "last", ["other-3", "e-6", "e-", "e-x", "e-1", "-", "e--1", "e-" + "9" * 30, "e-²"]
)
def test_what_cannot_be_known_is_asked_for_anew(last):
    stream = EventStream("e", events_max=2)
    for number in range(5):
        stream.put("log", number)
    assert stream.after(last) == (5, True)


def test_too_slow_is_told_apart():
    stream = EventStream("e", events_max=2)
    stream.put("log", 0)
    (first,) = stream.wait(0, 0)
    for number in range(3):
        stream.put("log", number)
    assert stream.wait(first.number, 0) is None


def test_kept_events_are_bounded_in_bytes():
    stream = EventStream("e", bytes_max=1000)
    for _ in range(10):
        stream.put("log", "x" * 300)
    assert stream.after("e-6") == (10, True)
    assert stream.after("e-7") == (7, False)


def test_a_waiting_page_is_woken_by_an_event_and_by_the_end():
    stream, got = EventStream("e"), []
    thread = threading.Thread(target=lambda: got.append(stream.wait(0, PATIENCE_S)))
    thread.start()
    stream.put("log", 1)
    thread.join(PATIENCE_S)
    assert [event.number for event in got[0]] == [1]
    thread = threading.Thread(target=lambda: got.append(stream.wait(1, PATIENCE_S)))
    thread.start()
    stream.close()
    thread.join(PATIENCE_S)
    assert got[1] == []
    assert stream.closed


def test_only_so_many_follow():
    stream, held = EventStream("e"), []
    for _ in range(FOLLOWERS_MAX):
        page = stream.followed()
        assert page.__enter__()
        held.append(page)
    with stream.followed() as welcome:
        assert not welcome
    assert stream.followers == FOLLOWERS_MAX
    held.pop().__exit__(None, None, None)
    with stream.followed() as welcome:
        assert welcome


def test_an_event_without_a_number_keeps_the_pages_place():
    assert sse("beat", {}) == b"event: beat\ndata: {}\n\n"
