"""What a stack printed is cut out of its log by attempt: exact limits, and what is shared."""

import os
import tempfile

import pytest

from twin.base.process import LOG_BYTES_MAX, bound_log, left_by_itself, raised_in
from twin.rig.stack_output import (
    HEAD_BYTES,
    NEIGHBOURS_SHOWN,
    TAIL_BYTES,
    Kept,
    StackOutput,
    readable,
)


@pytest.fixture
def log():
    with tempfile.TemporaryFile() as file:
        yield file


def say(log, data):
    os.write(log.fileno(), data)


def test_an_attempt_has_what_came_between_its_start_and_its_end(log):
    output = StackOutput(log.fileno())
    say(log, b"loads\n")
    output.begin(1, "a")
    say(log, b"first\n")
    assert output.end(1).text() == "--- printed by the stack ---\nloads\nfirst\n"
    say(log, b"between\n")
    output.begin(2, "b")
    say(log, b"second")
    assert output.end(2).text() == "--- printed by the stack ---\nbetween\nsecond\n"
    output.begin(3, "c")
    assert output.end(3).text() == "--- the stack printed nothing ---\n"


def test_lines_of_cases_that_ran_together_are_in_all_their_logs(log):
    output = StackOutput(log.fileno())
    say(log, b"loads\n")
    output.begin(1, "a")
    output.begin(2, "b")
    output.look()
    say(log, b"of a or b\n")
    kept = output.end(1)
    assert kept.neighbours == ("b",)
    say(log, b"of b\n")
    output.begin(3, "c")
    say(log, b"of b or c\n")
    assert output.end(2).text().splitlines()[1:] == ["loads", "of a or b", "of b", "of b or c"]
    kept = output.end(3)
    assert (kept.head, kept.neighbours) == (b"of b or c\n", ("b",))
    many = Kept(b"x", b"", 0, tuple(f"c{i}" for i in range(NEIGHBOURS_SHOWN + 2)))
    assert " c7 and 2 more ---" in many.text()


@pytest.mark.parametrize("beyond", [0, 1])
def test_head_and_tail_are_kept_and_the_rest_is_counted(log, beyond):
    output = StackOutput(log.fileno())
    say(log, b"of an earlier case\n")
    output.begin(1, "a")
    output.end(1)
    output.begin(2, "b")
    say(log, b"h" * HEAD_BYTES + b"m" * beyond + b"t" * TAIL_BYTES)
    kept = output.end(2)
    assert (set(kept.head), set(kept.tail)) == ({ord("h")}, {ord("t")})
    assert (len(kept.head), len(kept.tail), kept.dropped) == (HEAD_BYTES, TAIL_BYTES, beyond)
    assert ("--- 1 bytes left out ---" in kept.text()) is bool(beyond)


def test_the_beginning_of_a_later_flood_outlives_the_bound_of_the_log(log):
    output = StackOutput(log.fileno())
    output.begin(1, "a")
    flood = 2 * LOG_BYTES_MAX
    say(log, b"a" * flood)
    bound_log(log, output.starts(), HEAD_BYTES)
    output.end(1)
    output.begin(2, "b")
    say(log, b"begins\n" + b"b" * flood + b"\nends\n")
    bound_log(log, output.starts(), HEAD_BYTES)
    assert os.fstat(log.fileno()).st_blocks * 512 < LOG_BYTES_MAX
    kept = output.end(2)
    assert kept.head.startswith(b"begins\nbbb")
    assert kept.tail.endswith(b"b\nends\n")
    assert b"a" not in kept.head
    assert kept.dropped == len("begins\n\nends\n") + flood - HEAD_BYTES - TAIL_BYTES


def test_what_was_given_back_to_the_disk_is_counted_as_left_out(log):
    output = StackOutput(log.fileno())
    say(log, b"x" * 2 * LOG_BYTES_MAX)
    bound_log(log)
    output.begin(1, "a")
    kept = output.end(1)
    assert kept.dropped == 2 * LOG_BYTES_MAX - HEAD_BYTES - TAIL_BYTES
    assert "\0" not in kept.text()


def test_control_characters_are_written_out(log):
    output = StackOutput(log.fileno())
    output.begin(1, "a")
    say(log, b"\x1b[2J\tred\r\nbar 1\rbar 2\xff\n")
    lines = output.end(1).text().splitlines()
    assert lines[1:] == ["\\x1b[2J\tred", "bar 1", "bar 2\ufffd"]


def test_a_log_of_another_process_is_read_without_moving_its_end(log):
    descriptor = readable(os.dup(log.fileno()))
    output = StackOutput(descriptor)
    output.begin(1, "a")
    say(log, b"one\n")
    output.look()
    say(log, b"two\n")
    assert output.end(1).head == b"one\ntwo\n"
    os.close(descriptor)
    assert readable(-1) is None
    assert readable(99_999) is None
    elsewhere = StackOutput(None)
    elsewhere.begin(1, "a")
    assert elsewhere.end(1) is None


TRACEBACK = """Traceback (most recent call last):
  File "a.py", line 3, in <module>
    f()
    ~^^
ValueError: bad
  more of it
"""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("fine\n", ""),
        (f"before\n{TRACEBACK}after\n", "ValueError: bad"),
        (f"{TRACEBACK}{TRACEBACK.replace('bad', 'worse')}", "ValueError: worse"),
        ("Traceback (most recent call last):\n  cut off", ""),
    ],
)
def test_what_was_raised_is_found_in_a_log(log, text, line):
    say(log, text.encode())
    assert raised_in(log) == line


@pytest.mark.parametrize(
    ("code", "own"),
    [(0, True), (1, True), (125, True), (126, False), (137, False), (-9, False), (3, False)],
)
def test_which_exit_codes_are_a_stacks_own_doing(code, own):
    """Not those of signals, of commands that could not be run, and of our own lost connections."""
    assert left_by_itself(code) is own
    assert not left_by_itself(75)
