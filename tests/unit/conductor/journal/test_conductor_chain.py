"""The journal is a hash chain: whatever is changed in it is found when it is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from conductor.core.facts import CaseEnded, Fact, Image, Replied, Snapshot, WorkerLeft
from conductor.journal.chain import Chain
from conductor.journal.owner import FILE_NAME as OWNER_FILE
from conductor.journal.owner import FolderOwner
from conductor.journal.store import Journal, JournalError, TakenOverError, read_journal
from schemas import SCHEMA_VERSION
from schemas.wire.control import Reply


def _some(number: int) -> Fact:
    return CaseEnded(campaign="alpha", case=str(number), outcome="cancelled", reason="")


def _replied(worker: str, seq: int) -> Replied:
    return Replied(worker, seq, Reply(v=SCHEMA_VERSION, epoch=1, seq=seq))


def _snapshot(*keys: str) -> Snapshot:
    return Snapshot(images=[Image(key, key.encode() * 3) for key in keys])


FACTS: Sequence[Fact] = (
    *(_some(1), _snapshot("0", "1/a", "2/a"), _some(2)),
    *(_snapshot("0", "2/b"), _replied("w1", 4), _replied("w2", 1)),
    *(_some(3), _some(4), _replied("w1", 5), _some(5), _some(6)),
)


def _written(folder: Path, facts: Sequence[Fact] = FACTS) -> Chain:
    journal = Journal(folder)
    for fact in facts:
        journal.append([fact])
    journal.close()
    return journal.chain


def _read(folder: Path) -> list[Fact]:
    journal = Journal(folder)
    try:
        return list(journal.fold())
    finally:
        journal.close()


def _change(folder: Path, *statements: str) -> None:
    with closing(sqlite3.connect(folder / "conductor.db")) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def test_what_was_written_is_read_with_its_chain(tmp_path: Path) -> None:
    chain = _written(tmp_path)
    found = _read(tmp_path)
    assert [f for f in found if isinstance(f, CaseEnded)] == [_some(n) for n in (3, 4, 5, 6)]
    assert chain.count == 8  # replies are none of its links
    again, facts = read_journal(tmp_path / "conductor.db")
    assert again == chain
    assert list(facts) == found


def test_a_chain_goes_on_where_it_was(tmp_path: Path) -> None:
    chain = _written(tmp_path, FACTS[:6])
    journal = Journal(tmp_path)
    assert journal.chain == chain
    journal.append(FACTS[6:])
    journal.close()
    assert journal.chain.count == 8
    assert len(_read(tmp_path)) == 7


def test_a_worker_that_left_takes_its_reply_out_of_the_sum(tmp_path: Path) -> None:
    _written(tmp_path, [_replied("w1", 1), WorkerLeft("w1"), WorkerLeft("w2")])
    assert _read(tmp_path) == [WorkerLeft("w1"), WorkerLeft("w2")]


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE facts SET unix_s = unix_s + 1 WHERE id = 2",
        "UPDATE facts SET fact = (SELECT fact FROM facts WHERE id = 1) WHERE id = 2",
        "UPDATE facts SET chain = (SELECT chain FROM facts WHERE id = 1) WHERE id = 2",
        "UPDATE facts SET chain = NULL WHERE id = 4",
        "DELETE FROM facts WHERE id = 1",
        "DELETE FROM facts WHERE id = 2",
        "DELETE FROM facts WHERE id = 4",
        "DELETE FROM facts",
        "UPDATE facts SET id = 9 WHERE id = 2",
        "INSERT INTO facts SELECT 5, unix_s, fact, chain FROM facts WHERE id = 1",
        "INSERT INTO facts SELECT 0, unix_s, fact, chain FROM facts WHERE id = 1",
        "UPDATE snapshot SET image = CAST(image || x'00' AS BLOB) WHERE key = '1/a'",
        "UPDATE snapshot SET key = '1/b' WHERE key = '1/a'",
        "DELETE FROM snapshot WHERE key = '2/a'",
        "DELETE FROM snapshot",
        "INSERT INTO snapshot VALUES ('2/c', x'00')",
        "UPDATE replies SET reply = (SELECT reply FROM replies WHERE worker = 'w2')",
        "UPDATE replies SET seq = 7 WHERE worker = 'w1'",
        "DELETE FROM replies WHERE worker = 'w1'",
        "INSERT INTO replies SELECT 'w3', seq, reply FROM replies WHERE worker = 'w1'",
        "DELETE FROM meta WHERE name = 'chain'",
        "UPDATE meta SET value = '{}' WHERE name = 'chain'",
        "UPDATE meta SET value = 'x' WHERE name = 'chain'",
        "UPDATE meta SET value = replace(value, '\"count\":8', '\"count\":9')",
    ],
)
def test_a_changed_journal_is_refused_in_one_line(tmp_path: Path, change: str) -> None:
    _written(tmp_path)
    _change(tmp_path, change)
    with pytest.raises(JournalError, match="the chain of facts does not fit") as caught:
        _read(tmp_path)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 3
    with pytest.raises(JournalError, match="the chain of facts does not fit"):
        list(read_journal(tmp_path / "conductor.db")[1])


def test_a_failed_write_leaves_the_chain_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connections: list[sqlite3.Connection] = []
    connect = sqlite3.connect

    def connecting(*arguments: Any, **options: Any) -> sqlite3.Connection:
        connections.append(connect(*arguments, **options))
        return connections[-1]

    with monkeypatch.context() as patch:
        patch.setattr(sqlite3, "connect", connecting)
        journal = Journal(tmp_path)
    journal.append([_some(1)])
    before = journal.chain
    connections[0].execute(
        "CREATE TRIGGER full BEFORE INSERT ON facts BEGIN SELECT RAISE(FAIL, 'no'); END"
    )
    with pytest.raises(JournalError):
        journal.append([_snapshot("0"), _some(2)])
    assert journal.chain == before
    connections[0].execute("DROP TRIGGER full")
    journal.append([_snapshot("1/a"), _some(3)])
    journal.close()
    assert _read(tmp_path) == [_snapshot("1/a"), _some(3)]


def test_a_takeover_leaves_the_chain_where_it_was(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.append([_some(1)])
    before = journal.chain
    thief = FolderOwner(id="thief", host="there", pid=2)
    (tmp_path / OWNER_FILE).write_bytes(msgspec.json.encode(thief))
    with pytest.raises(TakenOverError):
        journal.append([_some(2)])
    assert journal.chain == before
    journal.close()
