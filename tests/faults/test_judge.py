"""The judge of the table sees what is lost, doubled and wrong; the name server answers."""

import struct

import pytest
from injection import Outcome
from ledger import Quiet, count
from name_server import answer
from table import BEGIN, END, markdown, put_into, tabulate
from wire_messages import case

from conductor.core.case_table import pack
from conductor.core.facts import Committed, LateAttempt, Submitted
from conductor.journal.store import Journal
from schemas.wire.control import Result

PEACE = Quiet("f" * 64, {"a": "1" * 64, "b": "2" * 64})


def committed(case, digest, token=1):
    """A fact."""
    return Committed(result(case, digest, token), "w", "cpu:x", 1)


def result(case, digest, token=1):
    """Of a case."""
    return Result("c", case, token, "verdict", "pass", kpi_sha256=digest * 64)


def judge(tmp_path, *facts):
    """What the judge says about a journal of these facts."""
    journal = Journal(tmp_path)
    journal.append([Submitted({}, pack([case()]), "d", str(tmp_path / "c")), *facts])
    journal.close()
    found = count(tmp_path, 1, PEACE)
    return found.cases, found.lost, found.doubled, found.wrong


def test_a_lost_case(tmp_path):
    assert judge(tmp_path, committed("a", "1")) == (2, 1, 0, 0)


def test_a_doubled_case(tmp_path):
    assert judge(tmp_path, committed("a", "1"), committed("a", "1", 2)) == (2, 1, 1, 0)


def test_wrong_bytes(tmp_path):
    assert judge(tmp_path, committed("a", "2")) == (2, 1, 0, 1)


def test_wrong_bytes_of_a_late_attempt(tmp_path):
    late = LateAttempt(result("a", "3", 2), "w")
    assert judge(tmp_path, committed("a", "1"), late) == (2, 1, 0, 1)


def test_a_lost_campaign(tmp_path):
    Journal(tmp_path).close()
    with pytest.raises(AssertionError, match="a campaign was lost"):
        count(tmp_path, 1, PEACE)


def test_rows_add_up(tmp_path):
    outcomes = [
        Outcome("cut", 0, {"cut": 2}, [1.0, 3.0], True, 16, 0, 0, 0, 9.0),
        Outcome("storm", 0, {"cut": 3, "kill": 4}, [5.0], True, 32, 1, 0, 0, 9.0),
        Outcome("storm", 1, {"cut": 1}, [], True, 16, 0, 0, 2, 9.0),
    ]
    rows = tabulate(outcomes)
    assert [(r.fault, r.injected, r.cases, r.lost, r.wrong, r.clean) for r in rows] == [
        ("cut", 2, 16, 0, 0, True),
        ("storm", 8, 48, 1, 2, False),
        ("all", 10, 64, 1, 2, False),
    ]
    assert (rows[0].recovery_median_s, rows[2].recovery_worst_s) == (2.0, 5.0)
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    put_into(page, markdown(rows))
    text = page.read_text()
    assert "old" not in text
    assert "| storm | 8 | 48 | 1 | 0 | 2 | 5.0 s | 5.0 s |" in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")


def test_the_name_server_knows_one_name():
    def ask(name, kind=1):
        labels = b"".join(bytes([len(part)]) + part.encode() for part in name.split("."))
        query = b"id" + struct.pack("!5H", 0x0100, 1, 0, 0, 0) + labels + b"\0"
        return answer(query + struct.pack("!2H", kind, 1), "a.test", "10.0.0.1")

    assert ask("a.test").endswith(bytes([10, 0, 0, 1]))
    assert ask("b.test")[3] & 15 == 3, "no such name"
    assert ask("a.test", kind=28)[7] == 0, "a name without such a record"
