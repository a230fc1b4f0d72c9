"""The user's own folder of keys: private, found from a state folder, and none of anybody else's."""

import os
import re
import stat
import subprocess

import msgspec
import pytest

from twin.base.errors import UsageError
from twin.base.own_folder import VARIABLE, own_folder
from twin.fabric.discovery import FILE_NAME, ConductorFile, find_target
from twin.fabric.keys.authority import load_or_make, make_keys
from twin.fabric.keys.key_file import ExpiredKeyError, UnfitKeyError, load_key
from twin.fabric.keys.own_keys import MADE_FOR, SWEPT_MAX, fabric_folder, fabric_name
from twin.fabric.keys.roles import MEMBERS, Role


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder of this test's own, which is not there yet."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    return tmp_path / "own"


@pytest.fixture
def state(tmp_path):
    folder = tmp_path / "state"
    folder.mkdir()
    return folder


def mode(path):
    return stat.S_IMODE(path.lstat().st_mode)


def announce(folder, **values):
    content = ConductorFile("tls/127.0.0.1:1", 1, "h", 1, "twin", "0", **values)
    (folder / FILE_NAME).write_bytes(msgspec.json.encode(content))


def test_where_it_is(tmp_path, monkeypatch):
    home = {VARIABLE: "/a/b", "XDG_CONFIG_HOME": "/c"}
    assert str(own_folder(home)) == "/a/b"
    assert str(own_folder({"XDG_CONFIG_HOME": "/c"})) == "/c/drivetwin"
    monkeypatch.setenv("HOME", str(tmp_path))
    assert own_folder({}) == tmp_path / ".config" / "drivetwin"


def test_keys_are_made_once_outside_of_the_state_folder(own, state):
    key = load_or_make(state)
    folder = own / "keys" / fabric_name(state)
    assert (key.role, key.path.parent) == (Role.conductor, folder)
    assert list(state.iterdir()) == [], "nothing of it where stacks may look"
    assert {mode(own), mode(own / "keys"), mode(folder)} == {0o700}
    assert {mode(path) for path in folder.iterdir()} == {0o600}
    assert {f"{role}.key" for role in MEMBERS} < set(os.listdir(folder))
    assert load_or_make(state).private == key.private, "and found again"
    assert load_or_make(state.parent / "other").fabric != key.fabric


def test_the_umask_leaves_them_private(own, state):
    before = os.umask(0)
    try:
        load_or_make(state)
    finally:
        os.umask(before)
    assert {mode(path) & 0o077 for path in (own, own / "keys", *own.rglob("*"))} == {0}


def test_a_role_finds_its_key_from_a_state_or_campaign_folder(own, state):
    key = load_or_make(state)
    campaign = state / "campaign"
    campaign.mkdir()
    for folder in (state, campaign):
        announce(folder, fabric=fabric_name(state), key="/as/the/conductor/sees/it")
        for role in (Role.worker, Role.viewer, Role.submitter):
            found = find_target(folder, role).key
            assert (found.role, found.fabric) == (role, key.fabric)


def test_what_a_state_folder_says_is_no_path_to_keys(own, state, tmp_path):
    """Stacks may write there: it names a fabric of the user's own folder, or keys elsewhere."""
    load_or_make(state)
    planted = make_keys(state / "planted")
    announce(state, key=str(planted))
    with pytest.raises(UnfitKeyError, match="names no keys outside of its folder"):
        find_target(state, Role.worker)
    (state / "link").symlink_to(planted)
    announce(state, key=str(tmp_path / "state/link/../planted"))
    with pytest.raises(UnfitKeyError, match="names no keys outside of its folder"):
        find_target(state, Role.worker)
    for name in ("../../state/planted", "/tmp", "", "0123456789ABCDEF", "0" * 17):
        announce(state, fabric=name)
        with pytest.raises(UnfitKeyError, match=r"expected 16 hex|names no keys outside"):
            find_target(state, Role.worker)
    given = make_keys(tmp_path / "given")
    announce(state, key=str(given))
    assert find_target(state, Role.worker).key.path.parent == given, "as somebody typed it"


def test_keys_of_somebody_else_are_named(own, state):
    announce(state, fabric="0" * 16)
    with pytest.raises(UsageError, match="you have no keys of this conductor") as error:
        find_target(state, Role.worker)
    assert (VARIABLE in str(error.value), len(str(error.value).splitlines())) == (True, 1)


def loosened(path):
    path.chmod(0o770)


def linked(path):
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


def filed(path):
    path.rename(path.with_name("elsewhere"))
    path.touch(0o600)


def given_away(path):
    if os.geteuid() != 0:
        pytest.skip("needs root to give a folder away")
    os.chown(path, 12345, -1)


@pytest.mark.parametrize("which", ["own", "keys", "fabric"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (loosened, "mode 0770: others may"),
        (linked, "a symbolic link"),
        (filed, "no folder"),
        (given_away, "belongs to user id 12345, you are"),
    ],
)
def test_a_folder_that_others_reach_is_refused(own, state, which, change, words):
    name = fabric_name(state)
    load_or_make(state)
    announce(state, fabric=name)
    place = {"own": own, "keys": own / "keys", "fabric": own / "keys" / name}[which]
    change(place)
    for tried in (lambda: load_or_make(state), lambda: find_target(state, Role.viewer)):
        with pytest.raises(UsageError, match=re.escape(f"{place}: ") + f".*{words}") as error:
            tried()
        assert len(str(error.value).splitlines()) == 1


def test_a_home_that_cannot_be_written_is_one_line(tmp_path, state, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "own"))
    with pytest.raises(
        UsageError, match=f"Not a directory; set {VARIABLE} to a folder of your own"
    ):
        load_or_make(state)


def test_keys_of_an_earlier_version_are_refused_with_what_to_type(own, state):
    old = make_keys(state / "keys")
    with pytest.raises(UsageError, match="keys no longer belong in a state folder") as error:
        load_or_make(state)
    (old / "submitter.key").unlink()  # that role came later
    before = load_key(old, Role.conductor)
    subprocess.run(["sh", "-c", str(error.value).split("`")[1]], check=True)
    assert load_or_make(state).private == before.private, "what it said works"
    folder = fabric_folder(fabric_name(state))
    assert load_key(folder, Role.submitter).fabric == before.fabric, "and nothing is missing"
    (folder / "submitter.key").unlink()
    (folder / "authority.key").unlink()
    assert load_or_make(state).private == before.private, "as far as it can be made"


def test_expired_keys_are_made_anew(own, state):
    folder = load_or_make(state).path.parent
    make_keys(folder, days=-1, replace=True)
    with pytest.raises(ExpiredKeyError):
        load_key(folder, Role.conductor)
    again = load_or_make(state)
    assert load_or_make(state).fabric == again.fabric


@pytest.mark.slow
def test_keys_of_state_folders_that_are_gone_go_in_time(own, tmp_path):
    states = []
    for number in range(2 * SWEPT_MAX):
        states.append(tmp_path / f"state-{number}")
        states[-1].mkdir()
        load_or_make(states[-1])
    kept = [fabric_name(each) for each in states[::2]]
    elsewhere = own / "keys" / fabric_name(states[1]) / MADE_FOR
    elsewhere.write_text('{"host": "another", "state": "/gone"}')
    for each in states[1::2]:
        each.rmdir()
    for number in range(4 * SWEPT_MAX):
        last = tmp_path / f"later-{number}"
        last.mkdir()
        load_or_make(last)
    left = set(os.listdir(own / "keys"))
    assert {*kept, fabric_name(last)} <= left, "nobody's keys that are in use"
    assert fabric_name(states[1]) in left, "another host's are not judged here"
    gone = [each for each in states[3::2] if fabric_name(each) not in left]
    assert len(gone) == SWEPT_MAX - 1
