"""Files of attempts that come through the fabric: only what is asked for, whole, and once."""

import os

import msgpack
import pytest

from conductor.serve.deliveries import Deliveries
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import decode, encode
from schemas.wire.delivery import (
    FILES_BYTES_MAX,
    AttemptFiles,
    Delivered,
    SeenFolder,
    extras_sha256,
    files_sha256,
)


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "demo"


@pytest.fixture
def deliveries(folder):
    made = Deliveries(
        lambda message: (str(folder), "") if known(message) else ("", "has no such attempt")
    )
    yield made
    made.close()


def known(message):
    if isinstance(message, SeenFolder):
        return message.campaign == "demo"
    return (message.campaign, message.case) == ("demo", "c1") and message.attempt < 9


def attempt(
    case="c1", number=1, kpi=b"kpi", log=b"log", sha256=None, campaign="demo", extras=None, **more
):
    found = sha256 or files_sha256(kpi, log)
    extras = extras or {}
    more = {"extras_sha256": extras_sha256(extras), **more}
    return AttemptFiles(V, campaign, case, number, kpi, log, found, extras, **more)


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


def test_what_was_done_by_hand_and_by_the_clock_comes_too(deliveries, folder):
    extras = {"interventions.jsonl": b"{}\n", "realtime.csv": b"tick\n0\n"}
    assert deliveries.handle(encode(attempt(extras=extras))) == Delivered(V, True)
    found = {path.name: path.read_bytes() for path in (folder / "cases/c1/attempt-1").iterdir()}
    assert found == {"kpi.parquet": b"kpi", "log.txt": b"log", **extras}


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
        (attempt(case="../../etc"), "has no such attempt"),
        (attempt(case=""), "not a valid message"),
        (attempt(case="c2"), "has no such attempt"),
        (attempt(campaign="other"), "has no such attempt"),
        (attempt(campaign="../x"), "not a valid message"),
        (attempt(number=0), "not a valid message"),
        (attempt(sha256="0" * 64), "damaged on its way"),
        (attempt(extras={"realtime.csv": b"1"}, extras_sha256="0" * 64), "damaged on its way"),
        (attempt(extras={"realtime.csv": b"1"}, extras_sha256=""), "damaged on its way"),
        (attempt(extras={"../conductor.db": b"1"}), "not a valid message"),
        (attempt(extras={"conductor.json": b"1"}), "not a valid message"),
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
