"""Key files: private from the first byte, checked on every use, never shown."""

import os
import stat
import traceback

import pytest
from cryptography import x509

from twin.fabric import key_file
from twin.fabric.errors import UsageError
from twin.fabric.key_file import UnfitKeyError, load_key, load_or_make, make_key


@pytest.fixture
def made(tmp_path):
    return make_key(tmp_path / "fabric.key")


def test_a_new_key_is_private_whatever_the_umask(tmp_path):
    before = os.umask(0)
    try:
        key = make_key(tmp_path / "fabric.key")
    finally:
        os.umask(before)
    assert stat.S_IMODE(key.path.stat().st_mode) == 0o600
    assert [path.name for path in tmp_path.iterdir()] == ["fabric.key"]
    assert load_key(key.path) == key


def test_the_authority_cannot_sign_again(made):
    """Its private key is nowhere: the file holds one private key, the member's."""
    assert made.path.read_bytes().count(b"PRIVATE KEY-----\n") == 2  # begin and end
    certificate = x509.load_pem_x509_certificate(made.certificate)
    authority = x509.load_pem_x509_certificate(made.authority)
    certificate.verify_directly_issued_by(authority)
    assert certificate.public_key() != authority.public_key()
    assert certificate.not_valid_before_utc == authority.not_valid_before_utc


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o660, 0o601, 0o644])
def test_a_key_that_others_may_touch_is_refused(made, mode):
    made.path.chmod(mode)
    with pytest.raises(UnfitKeyError, match="chmod 600") as error:
        load_key(made.path)
    assert f"(mode {mode:04o})" in str(error.value)
    made.path.chmod(0o400)
    load_key(made.path)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give a file away")
def test_a_key_of_somebody_else_is_refused(made):
    os.chown(made.path, 12345, -1)
    with pytest.raises(UnfitKeyError, match="belongs to user id 12345, you are 0"):
        load_key(made.path)


def test_a_missing_key_says_where_to_get_one(tmp_path):
    with pytest.raises(UsageError, match="`conductor keygen FILE` makes one"):
        load_key(tmp_path / "fabric.key")


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_what_is_no_file_is_refused_at_once(tmp_path, kind):
    path = tmp_path / "fabric.key"
    path.mkdir(mode=0o700) if kind == "folder" else os.mkfifo(path, 0o600)
    with pytest.raises(UsageError, match="not a file"):
        load_key(path)


def damages(good):
    yield b""
    yield b"no key\n"
    yield good[: len(good) // 2]
    yield good[:-40]
    yield good.replace(b"BEGIN PRIVATE", b"BEGIN ENCRYPTED PRIVATE")
    yield good + b"x" * 100_000
    flipped = bytearray(good)
    flipped[200] = ord("A") if flipped[200] != ord("A") else ord("B")
    yield bytes(flipped)
    yield bytes(good[-700:])


def test_a_damaged_key_is_one_line_without_its_content(made, tmp_path):
    good = made.path.read_bytes()
    other = make_key(tmp_path / "other.key")
    mixed = made.certificate + other.private + made.authority
    strange = made.certificate + made.private + other.authority
    secret = good.split(b"-----BEGIN PRIVATE KEY-----")[1].split(b"\n")[1].decode()
    for data in [*damages(good), mixed, strange]:
        made.path.write_bytes(data)
        if data == good + b"x" * 100_000:
            load_key(made.path)  # what follows a whole key is cut off unread
            continue
        with pytest.raises(UnfitKeyError, match="damaged, or no key file") as error:
            load_key(made.path)
        assert len(str(error.value).splitlines()) == 1
        assert secret not in "".join(traceback.format_exception(error.value))


def test_a_key_never_shows_itself(made):
    assert repr(made) == f"Key({made.path})"
    assert "PRIVATE" not in f"{made!s} {made!r}"


def test_an_expired_key_is_named_with_its_date(tmp_path):
    path = tmp_path / "fabric.key"
    with pytest.raises(UnfitKeyError, match=r"expired on \d{4}-\d\d-\d\d; make a new one"):
        make_key(path, days=-1)
    with pytest.raises(UnfitKeyError, match="expired on"):
        load_or_make(path)


def test_a_clock_that_is_behind_is_tolerated_for_a_day(tmp_path, monkeypatch):
    path = make_key(tmp_path / "fabric.key").path
    for days, fits in ((1, True), (3, False)):
        monkeypatch.setattr(key_file, "datetime", _Behind(days))
        if fits:
            load_key(path)
            continue
        with pytest.raises(UnfitKeyError, match="set the clock"):
            load_key(path)


class _Behind:
    """The module ``datetime`` on a machine whose clock is some days behind."""

    def __init__(self, days):
        import datetime as real

        class Clock(real.datetime):
            @classmethod
            def now(cls, tz=None):
                return real.datetime.now(tz) - real.timedelta(days=days)

        self.datetime, self.timedelta, self.UTC = Clock, real.timedelta, real.UTC


def test_a_key_is_replaced_only_when_asked(made):
    with pytest.raises(UsageError, match="say --force"):
        make_key(made.path)
    assert load_key(made.path) == made
    assert make_key(made.path, replace=True) != made


def test_a_conductor_takes_the_key_that_is_there(tmp_path):
    path = tmp_path / "conductor.key"
    assert load_or_make(path) == load_or_make(path)
    path.unlink()
    path.symlink_to(tmp_path / "nowhere")
    with pytest.raises(UsageError, match="no such key file"):
        load_or_make(path)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(UsageError, match="there is no folder"):
        make_key(tmp_path / "nowhere" / "fabric.key")
