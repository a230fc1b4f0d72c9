"""Files of attempts that come through the fabric: only what is asked for, whole, and once."""

import os

import msgpack
import pytest

from conductor.deliveries import Deliveries
from schemas import SCHEMA_VERSION as V
from schemas.delivery import (
    FILES_BYTES_MAX,
    AttemptFiles,
    Delivered,
    SeenFolder,
    files_sha256,
)
from schemas.wire import decode, encode


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "demo"


@pytest.fixture
def deliveries(folder):
    made = Deliveries(
        lambda name, case, number: folder if (name, case) in KNOWN and number < 9 else None
    )
    yield made
    made.close()


KNOWN = {("demo", ""), ("demo", "c1")}
LEASED = 8
"""Attempts of the case."""


def attempt(case="c1", number=1, kpi=b"kpi", log=b"log", sha256=None, campaign="demo"):
    found = sha256 or files_sha256(kpi, log)
    return AttemptFiles(V, campaign, case, number, kpi, log, found)


def test_an_attempt_is_written_whole(deliveries, folder):
    answers = []
    deliveries.receive(encode(attempt()), answers.append)
    deliveries.close()
    assert [decode(data, Delivered) for data in answers] == [Delivered(V, True)]
    found = folder / "cases/c1/attempt-1"
    assert {path.name: path.read_bytes() for path in found.iterdir()} == {
        "kpi.parquet": b"kpi",
        "log.txt": b"log",
    }


def test_the_same_again_is_answered_the_same(deliveries, folder):
    message = encode(attempt())
    assert deliveries.handle(message) == deliveries.handle(message) == Delivered(V, True)
    other = deliveries.handle(encode(attempt(kpi=b"other")))
    assert (other.ok, other.retry) == (False, False)
    assert "is there already, with another content" in other.error
    assert (folder / "cases/c1/attempt-1/kpi.parquet").read_bytes() == b"kpi"


def test_half_an_attempt_is_completed(deliveries, folder):
    """The conductor was killed between the two files."""
    assert deliveries.handle(encode(attempt())).ok
    (folder / "cases/c1/attempt-1/log.txt").unlink()
    assert deliveries.handle(encode(attempt())).ok
    assert (folder / "cases/c1/attempt-1/log.txt").read_bytes() == b"log"


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (attempt(case="../../etc"), "has no case"),
        (attempt(case=""), "not a valid message"),
        (attempt(case="c2"), "has no case"),
        (attempt(campaign="other"), "has no case"),
        (attempt(campaign="../x"), "not a valid message"),
        (attempt(number=0), "not a valid message"),
        (attempt(sha256="0" * 64), "damaged on its way"),
    ],
)
def test_nothing_else_is_written(deliveries, folder, message, error):
    answer = deliveries.handle(encode(message))
    assert not answer.ok
    assert error in answer.error
    assert len(answer.error.splitlines()) == 1
    assert not folder.exists()


@pytest.mark.parametrize(
    "payload", [b"", b"\xc1", msgpack.packb({"v": V, "verb": "dance"}), msgpack.packb([])]
)
def test_what_is_no_message_is_refused(deliveries, payload):
    answer = deliveries.handle(payload)
    assert (answer.ok, answer.retry) == (False, False)
    assert answer.error


def test_too_much_is_refused(deliveries, folder):
    answer = deliveries.handle(encode(attempt(kpi=bytes(FILES_BYTES_MAX + (1 << 20)))))
    assert "are accepted" in answer.error
    assert not folder.exists()


def test_a_disk_that_fails_is_tried_again(deliveries, folder):
    folder.parent.mkdir(exist_ok=True)
    folder.write_bytes(b"in the way")
    answer = deliveries.handle(encode(attempt()))
    assert (answer.ok, answer.retry) == (False, True)


def test_only_the_same_folder_is_ours(deliveries, folder):
    import hashlib

    folder.mkdir()
    content = os.urandom(20)
    seen = SeenFolder(V, "demo", hashlib.sha256(content).hexdigest())
    assert not deliveries.handle(encode(seen)).ok, "there is no conductor.json yet"
    (folder / "conductor.json").write_bytes(content)
    assert deliveries.handle(encode(seen)).ok
    assert not deliveries.handle(encode(SeenFolder(V, "demo", "0" * 64))).ok
    assert not deliveries.handle(encode(SeenFolder(V, "other", seen.sha256))).ok
