"""What waits for its turn: how many at once, how many bytes, and who is turned away."""

from __future__ import annotations

import pytest

from conductor.serve.inbox import GROUP_MAX, Inbox
from schemas.wire.codec import MESSAGE_BYTES_MAX, decode
from schemas.wire.control import Reply


def filled(count: int, payload: bytes = b"x") -> tuple[Inbox, list[Reply]]:
    """An inbox with messages, and the replies of those that were turned away."""
    inbox, replies = Inbox(), []
    for _ in range(count):
        inbox.receive(payload, lambda data: replies.append(decode(data, Reply)))
    return inbox, replies


def test_a_transaction_takes_so_many_messages_and_no_more() -> None:
    inbox, _ = filled(GROUP_MAX + 3)
    assert [len(inbox.group(0.0)) for _ in range(3)] == [GROUP_MAX, 3, 0]


def test_what_was_taken_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("conductor.serve.inbox.WAITING_BYTES_MAX", 100)
    inbox, replies = filled(3, b"x" * 40)
    assert [reply.error for reply in replies] == ["busy: too many requests are waiting; retry"]
    assert replies[0].retry_after_s == 1.0
    for _ in range(3):
        assert len(inbox.group(0.0)) == 2
        inbox.receive(b"x" * 40, pytest.fail)
        inbox.receive(b"x" * 60, pytest.fail)
    assert inbox.turned_away == 1


def test_a_message_that_is_too_large_is_not_kept() -> None:
    inbox, replies = filled(1, bytes(MESSAGE_BYTES_MAX + 1))
    assert inbox.group(0.0) == []
    assert f"at most {MESSAGE_BYTES_MAX} are accepted" in replies[0].error
    inbox.receive(bytes(MESSAGE_BYTES_MAX), pytest.fail)
    assert len(inbox.group(0.0)) == 1


def test_a_wake_ends_the_wait_before_what_follows() -> None:
    inbox, _ = filled(2)
    inbox.wake()
    inbox.receive(b"y", pytest.fail)
    assert [len(inbox.group(9.0)) for _ in range(2)] == [2, 1]
