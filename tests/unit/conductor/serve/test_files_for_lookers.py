"""Logs and KPI rows of committed attempts over the bus: those, in pieces, and no other file."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import SimpleNamespace

import msgpack
import pytest
from committed_cases import COMMITTED, LEASED, LOG, CommittedCase, one_committed
from waiting import PATIENCE_S, wait_for

from conductor.core.facts import Committed
from conductor.serve import case_files
from conductor.serve.case_files import BYTES_PER_S, WAITING_MAX, CaseFiles
from schemas import SCHEMA_VERSION as V
from schemas.wire import topics
from schemas.wire.case_files import (
    PIECE_BYTES_MAX,
    REQUEST_BYTES_MAX,
    CaseFilePiece,
    CaseFileRequest,
)
from schemas.wire.codec import decode, encode
from twin.fabric.front.rules import BURST_S


@pytest.fixture
def served(tmp_path, hub):
    with one_committed(tmp_path / "state", hub) as committed:
        yield committed


def test_a_file_comes_in_pieces(served: CommittedCase):
    data, sizes = b"", []
    while len(data) < len(LOG):
        piece = served.piece("log.txt", len(data))
        assert (piece.error, piece.first, piece.size) == ("", len(data), len(LOG))
        assert piece.attempt == 1
        data += piece.data
        sizes.append(len(piece.data))
    assert data == LOG
    assert sizes == [PIECE_BYTES_MAX, len(LOG) - PIECE_BYTES_MAX]
    end = served.piece("log.txt", -1000)
    assert (end.data, end.first) == (LOG[-1000:], len(LOG) - 1000)
    assert served.piece("log.txt", len(LOG) + 5).data == b""
    rows = served.piece("kpi.parquet")
    assert rows.data == (served.attempt / "kpi.parquet").read_bytes()
    assert len(rows.kpi_sha256) == 64
    short = served.attempt / "log.txt"
    short.write_bytes(b"short")
    assert served.piece("log.txt", -1000).data == b"short"


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"case": LEASED}, "no result of it is committed"),
        ({"case": "nobody"}, "no case 'demo/nobody' here"),
        ({"case": f"../{COMMITTED}"}, "no case"),
        ({"case": f"{COMMITTED}/../{COMMITTED}"}, "no case"),
        ({"case": "a\x1b[2J\nb"}, r"no case 'demo/a\x1b[2J\nb' here"),
        ({"case": COMMITTED, "campaign": "other"}, "no case 'other/repeat_0' here"),
    ],
)
def test_only_what_the_journal_has_as_committed_is_given(served: CommittedCase, asked, words):
    piece = served.piece("log.txt", **asked)
    assert words in piece.error
    assert "\n" not in piece.error
    assert (piece.data, piece.retry) == (b"", False)


@pytest.mark.parametrize(
    "changes",
    [
        {"file": "../../../conductor.json"},
        {"file": "recording.rrd"},
        {"file": ""},
        {"campaign": "../demo"},
        {"campaign": "demo/.."},
        {"case": ""},
        {"first": -PIECE_BYTES_MAX - 1},
        {"first": 2**40},
        {"first": "0"},
    ],
)
def test_a_request_of_another_form_is_refused(served: CommittedCase, changes):
    asked = {"v": V, "campaign": "demo", "case": COMMITTED, "file": "log.txt", **changes}
    data = served.bus.request(topics.CASE_FILES.key, msgpack.packb(asked), PATIENCE_S)
    assert data is not None
    piece = decode(data, CaseFilePiece)
    assert piece.error
    assert piece.data == b""


def link_to_the_log(attempt: Path, secret: Path) -> None:
    (attempt / "log.txt").unlink()
    (attempt / "log.txt").symlink_to(secret)


def link_on_the_way(attempt: Path, secret: Path) -> None:
    there = secret.parent / "there"
    attempt.rename(there)
    (there / "log.txt").write_bytes(secret.read_bytes())
    attempt.symlink_to(there)


def pipe(attempt: Path, _: Path) -> None:
    (attempt / "log.txt").unlink()
    os.mkfifo(attempt / "log.txt")


def nothing(attempt: Path, _: Path) -> None:
    (attempt / "log.txt").unlink()


@pytest.mark.parametrize("evil", [link_to_the_log, link_on_the_way, pipe, nothing])
def test_a_file_that_is_none_is_refused(served: CommittedCase, tmp_path, evil):
    secret = tmp_path / "secret"
    secret.write_bytes(b"a word that nobody else knows")
    evil(served.attempt, secret)
    piece = served.piece("log.txt")
    assert piece.error.startswith(f"cases/{COMMITTED}/attempt-1/log.txt: ")
    assert piece.data == b""
    assert str(tmp_path) not in piece.error
    assert not served.piece("kpi.parquet").error or evil is link_on_the_way


def one_case(out: Path) -> SimpleNamespace:
    """What a conductor knows of campaign ``demo`` with case ``c``, which left an empty folder."""
    result = SimpleNamespace(kpi_sha256="0" * 64)
    end = Committed(result=result, worker="w", device_class="cpu", attempt=1)
    case = SimpleNamespace(case=SimpleNamespace(id="c"), end=end)
    demo = SimpleNamespace(cases={"c": case}, out=str(out))
    return SimpleNamespace(state=SimpleNamespace(campaigns={"demo": demo}))


def test_more_than_is_given_in_a_second_is_put_off(tmp_path):
    """By the time that it is told, not by a clock. What is not here costs the others nothing."""
    files = CaseFiles(one_case(tmp_path), threading.Lock())
    none = encode(CaseFileRequest(v=V, campaign="demo", case="nobody", file="log.txt"))
    for _ in range(2 * int(BURST_S * BYTES_PER_S) // case_files.ASKED_BYTES):
        assert "no case" in files.handle(none, 100.0).error
    asked = encode(CaseFileRequest(v=V, campaign="demo", case="c", file="log.txt"))
    burst = int(BURST_S * BYTES_PER_S)
    answers = [files.handle(asked, 100.0) for _ in range(burst // case_files.ASKED_BYTES + 1)]
    given = [answer for answer in answers if not answer.retry]
    # Each costs no more than itself; the last ones need room for a whole piece.
    assert len(given) > (burst - PIECE_BYTES_MAX) // case_files.ASKED_BYTES - 2
    assert "busy" in answers[-1].error
    assert files.handle(asked, 100.0).retry
    assert "no case" in files.handle(none, 100.0).error
    assert not files.handle(asked, 101.0).retry
    files.close()


def test_too_many_at_once_are_put_off_and_the_others_answered(tmp_path):
    nobody = SimpleNamespace(state=SimpleNamespace(campaigns={}))
    lock = threading.Lock()
    files = CaseFiles(nobody, lock)
    asked = encode(CaseFileRequest(v=V, campaign="demo", case="c", file="log.txt"))
    answers: list[bytes] = []
    with lock:  # a turn of the conductor that takes long
        for _ in range(WAITING_MAX + 2):  # one may be taken already
            files.receive(asked, answers.append)
        assert answers
        assert all(decode(answer, CaseFilePiece).retry for answer in answers)
    wait_for(lambda: len(answers) == WAITING_MAX + 2, "all answered")
    files.close()
    files = CaseFiles(nobody, lock)
    files.receive(bytes(REQUEST_BYTES_MAX + 1), answers.append)
    files.close()
    assert "at most 4096 are accepted" in decode(answers[-1], CaseFilePiece).error


def test_a_conductor_that_ends_reads_nothing_more():
    """Its sessions have ended before: nobody hears an answer."""
    nobody = SimpleNamespace(state=SimpleNamespace(campaigns={}))
    lock = threading.Lock()
    files = CaseFiles(nobody, lock)
    asked = encode(CaseFileRequest(v=V, campaign="demo", case="c", file="log.txt"))
    answers: list[bytes] = []
    with lock:
        for _ in range(WAITING_MAX):
            files.receive(asked, answers.append)
        closing = threading.Thread(target=files.close)
        closing.start()
        wait_for(lambda: files.answering.ended, "it ends")
    closing.join(PATIENCE_S)
    assert not closing.is_alive()
    assert len(answers) <= 1, "of the one that was taken already"
