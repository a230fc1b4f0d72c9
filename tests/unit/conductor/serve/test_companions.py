"""For whom a commit waits: exact limits, and the wait itself."""

import threading
import time

from conductor.serve.companions import (
    SKIPPED_MAX,
    SLOW_COMMIT_S,
    WAIT_MAX_S,
    WAIT_SHARE,
    Companions,
)
from conductor.serve.inbox import GROUP_MAX, Inbox

LONG_S = 600.0


def test_after_a_slow_commit_those_that_were_answered_are_waited_for():
    companions = Companions()
    companions.committed(SLOW_COMMIT_S, replies=1, waiting=2, now_s=5.0)
    assert companions.expected == 3
    assert companions.until_s == 5.0 + WAIT_SHARE * SLOW_COMMIT_S
    companions.committed(10.0, replies=2, waiting=0, now_s=7.0)
    assert (companions.expected, companions.until_s) == (2, 7.0 + WAIT_MAX_S)


def test_nobody_is_waited_for_after_a_quick_commit_or_without_an_answer():
    companions = Companions()
    companions.committed(1.0, replies=1, waiting=1, now_s=0.0)
    companions.committed(SLOW_COMMIT_S * 0.999, replies=1, waiting=1, now_s=0.0)
    assert companions.expected == 0
    companions.committed(1.0, replies=0, waiting=1, now_s=0.0)
    assert companions.expected == 0


def test_waits_in_vain_become_rare_and_one_that_pays_brings_them_back():
    companions = Companions()

    def skipped() -> int:
        """Commits without a wait until the next with one."""
        count = 0
        while True:
            companions.committed(1.0, replies=1, waiting=0, now_s=0.0)
            if companions.expected:
                return count
            count += 1

    counts = []
    for _ in range(7):
        counts.append(skipped())
        companions.waited(0)
    assert counts == [0, 2, 4, 8, 16, 16, 16]
    assert counts[-1] == SKIPPED_MAX
    assert skipped() == SKIPPED_MAX
    companions.waited(1)
    assert skipped() == 0
    companions.waited(0)
    assert skipped() == 2


def awaiting(count: int, until_s: float) -> Companions:
    return Companions(expected=count, until_s=until_s)


def test_a_group_waits_for_its_companions():
    inbox = Inbox()
    inbox.receive(b"a", lambda _: None)
    late = threading.Thread(target=inbox.receive, args=(b"b", lambda _: None))
    late.start()
    group = inbox.group(LONG_S, awaiting(2, time.monotonic() + LONG_S))
    late.join()
    assert [message.payload for message, _ in group] == [b"a", b"b"]


def test_a_group_waits_for_nobody_when_all_are_there_or_the_time_is_over():
    inbox = Inbox()
    for until_s in (time.monotonic() + LONG_S, 0.0):
        inbox.receive(b"a", lambda _: None)
        companions = awaiting(1 if until_s else 2, until_s)
        assert len(inbox.group(LONG_S, companions)) == 1
        assert companions == awaiting(companions.expected, until_s), "nothing was learned"


def test_a_group_that_waits_in_vain_goes_without():
    inbox = Inbox()
    inbox.receive(b"a", lambda _: None)
    companions = awaiting(2, time.monotonic() + 0.001)
    assert len(inbox.group(LONG_S, companions)) == 1
    inbox.wake()
    assert inbox.group(LONG_S, awaiting(2, time.monotonic() + LONG_S)) == []


def test_a_full_group_waits_for_nobody():
    inbox = Inbox()
    for _ in range(GROUP_MAX + 1):
        inbox.receive(b"a", lambda _: None)
    companions = awaiting(2 * GROUP_MAX, time.monotonic() + LONG_S)
    assert len(inbox.group(LONG_S, companions)) == GROUP_MAX
    assert inbox.waiting == 1


def test_a_wake_ends_the_wait():
    inbox = Inbox()
    inbox.receive(b"a", lambda _: None)
    threading.Thread(target=inbox.wake).start()
    group = inbox.group(LONG_S, awaiting(3, time.monotonic() + LONG_S))
    assert [message.payload for message, _ in group] == [b"a"]
