"""Key files: private from the first byte, checked on every use, never shown."""

import datetime
import os
import stat
import traceback

import pytest
from cryptography import x509

from twin.base.errors import UsageError
from twin.fabric.keys import key_file
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.key_file import UnfitKeyError, as_line, load_key, shared
from twin.fabric.keys.roles import MEMBERS, Role


@pytest.fixture
def made(tmp_path):
    return load_key(make_keys(tmp_path / "keys"), Role.viewer)


def test_a_new_key_is_private_whatever_the_umask(tmp_path):
    before = os.umask(0)
    try:
        keys = make_keys(tmp_path / "keys")
    finally:
        os.umask(before)
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys.iterdir()} == {0o600}
    names = {path.name for path in keys.iterdir()}
    assert names == {"authority.key", *(f"{role}.key" for role in MEMBERS)}
    assert [path.name for path in tmp_path.iterdir()] == ["keys"]
    found = {role: load_key(keys, role) for role in MEMBERS}
    assert [key.role for key in found.values()] == list(MEMBERS)
    assert len({key.fabric for key in found.values()}) == 1
    assert len({key.private for key in found.values()}) == len(MEMBERS)
    assert load_key(keys / "viewer.key", Role.admin) == found[Role.viewer], "a file is what it is"


def test_others_are_told_the_folder_or_a_key_that_lies_alone(tmp_path):
    keys = make_keys(tmp_path / "keys")
    assert shared(load_key(keys, Role.conductor)) == keys
    alone = tmp_path / "mine.key"
    (keys / "conductor.key").rename(alone)
    told = shared(load_key(alone, Role.conductor))
    assert load_key(told, Role.worker).role is Role.conductor


def test_a_member_cannot_sign(made):
    """The authority's private key is in its own file: a member's holds one, the member's."""
    assert made.path.read_bytes().count(b"PRIVATE KEY-----\n") == 2  # begin and end
    certificate = x509.load_pem_x509_certificate(made.certificate)
    authority = x509.load_pem_x509_certificate(made.authority)
    certificate.verify_directly_issued_by(authority)
    assert certificate.public_key() != authority.public_key()
    later = certificate.not_valid_before_utc - authority.not_valid_before_utc
    assert datetime.timedelta(0) <= later < datetime.timedelta(hours=1), "clocks of hosts differ"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o660, 0o601, 0o644])
def test_a_key_that_others_may_touch_is_refused(made, mode):
    made.path.chmod(mode)
    with pytest.raises(UnfitKeyError, match="chmod 600") as error:
        load_key(made.path, Role.viewer)
    assert f"(mode {mode:04o})" in str(error.value)
    made.path.chmod(0o400)
    load_key(made.path, Role.viewer)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give a file away")
def test_a_key_of_somebody_else_is_refused(made):
    os.chown(made.path, 12345, -1)
    with pytest.raises(UnfitKeyError, match="belongs to user id 12345, you are 0"):
        load_key(made.path, Role.viewer)


def test_a_missing_key_says_where_to_get_one(tmp_path):
    with pytest.raises(UsageError, match="`conductor invite` makes one"):
        load_key(tmp_path / "fabric.key", Role.viewer)


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fabric.key", 0o600)
    with pytest.raises(UsageError, match="not a file"):
        load_key(tmp_path / "fabric.key", Role.viewer)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"empty/viewer\.key: no such key file"):
        load_key(tmp_path / "empty", Role.viewer)


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
    other = load_key(make_keys(tmp_path / "others"), Role.viewer)
    mixed = made.certificate + other.private + made.authority
    strange = made.certificate + made.private + other.authority
    secret = good.split(b"-----BEGIN PRIVATE KEY-----")[1].split(b"\n")[1].decode()
    for data in [*damages(good), mixed, strange]:
        made.path.write_bytes(data)
        if data == good + b"x" * 100_000:
            load_key(made.path, Role.viewer)  # what follows a whole key is cut off unread
            continue
        with pytest.raises(UnfitKeyError, match="damaged, or no key file") as error:
            load_key(made.path, Role.viewer)
        assert len(str(error.value).splitlines()) == 1
        assert secret not in "".join(traceback.format_exception(error.value))


def test_a_key_never_shows_itself(made):
    assert repr(made) == f"Key({made.path})"
    assert "PRIVATE" not in f"{made!s} {made!r}"


def test_an_expired_key_is_named_with_its_date(tmp_path):
    keys = make_keys(tmp_path / "keys", days=-1)
    with pytest.raises(UnfitKeyError, match=r"expired on \d{4}-\d\d-\d\d; ask for a new one"):
        load_key(keys, Role.viewer)
    with pytest.raises(UnfitKeyError, match="expired on"):
        load_authority(keys)


def test_a_clock_that_is_behind_is_tolerated_for_a_day(tmp_path, monkeypatch):
    path = make_keys(tmp_path / "keys")
    for days, fits in ((1, True), (3, False)):
        monkeypatch.setattr(key_file, "datetime", _Behind(days))
        if fits:
            load_key(path, Role.viewer)
            continue
        with pytest.raises(UnfitKeyError, match="set the clock"):
            load_key(path, Role.viewer)


class _Behind:
    """The module ``datetime`` on a machine whose clock is some days behind."""

    def __init__(self, days):
        import datetime as real

        class Clock(real.datetime):
            @classmethod
            def now(cls, tz=None):
                return real.datetime.now(tz) - real.timedelta(days=days)

        self.datetime, self.timedelta, self.UTC = Clock, real.timedelta, real.UTC


def test_keys_are_replaced_only_when_asked(tmp_path, made):
    keys = made.path.parent
    with pytest.raises(UsageError, match="say --force"):
        make_keys(keys)
    assert load_key(keys, Role.viewer) == made
    assert load_key(make_keys(keys, replace=True), Role.viewer).fabric != made.fabric
    assert [path.name for path in tmp_path.iterdir()] == ["keys"], "nothing is left of the old ones"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").touch()
    with pytest.raises(UsageError, match="not a folder of keys"):
        make_keys(tmp_path / "mine", replace=True)
    assert (tmp_path / "mine/thesis.tex").exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(UsageError, match="there is no folder"):
        make_keys(tmp_path / "nowhere" / "keys")


def test_an_invitation_says_where_and_ends_with_its_authority(tmp_path):
    """As a file and as a line, which is one."""
    authority = load_authority(make_keys(tmp_path / "keys", days=10))
    path = tmp_path / "mine.key"
    data = authority.issue(Role.stack, 30, "tls/login:7447", "mine")
    for content in (data, as_line(data), as_line(data) + b"\n"):
        path.write_bytes(content)
        path.chmod(0o600)
        key = load_key(path, Role.viewer)
        assert (key.role, key.fabric) == (Role.stack, authority.fabric)
        assert (key.endpoint, key.namespace) == ("tls/login:7447", "mine")
    certificate = x509.load_pem_x509_certificate(key.certificate)
    assert certificate.not_valid_after_utc == authority.certificate.not_valid_after_utc
    for cut in (as_line(data)[:-7], as_line(data)[:1000] + b"\n" + as_line(data)[1000:], b"~"):
        path.write_bytes(as_line(b"") + cut.removeprefix(as_line(b"")))
        with pytest.raises(UnfitKeyError, match=r"cut off or changed|damaged"):
            load_key(path, Role.viewer)


def test_an_authority_that_is_gone_or_no_authority_is_named(tmp_path):
    keys = make_keys(tmp_path / "keys")
    (keys / "authority.key").write_bytes((keys / "admin.key").read_bytes())
    with pytest.raises(UnfitKeyError, match="damaged"):
        load_authority(keys)
    (keys / "authority.key").chmod(0o644)
    with pytest.raises(UnfitKeyError, match="chmod 600"):
        load_authority(keys)
    (keys / "authority.key").unlink()
    with pytest.raises(UsageError, match="was removed"):
        load_authority(keys)
    with pytest.raises(UsageError, match="no such key file"):
        load_authority(tmp_path / "nowhere")
