"""``devkit host --join``: only what this user announced, where nobody else can write."""

import json
import os
import subprocess
import sys

import pytest
from waiting import PATIENCE_S

from devkit.hosting.joining import (
    FILE_BYTES_MAX,
    Announcements,
    UnfitError,
    read_announcement,
    run_join,
)
from twin.base.errors import UsageError
from twin.worker.announcement import Announcement

GOOD = ["--connect", "tcp/127.0.0.1:1", "--rig", "r1", "--stack", "devkit.aeb:AebStack"]
RUNS = [*GOOD, "--foreign", json.dumps({"command": ["sh", "-c", "touch pwned"]})]

ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give a file away")


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "rigs"
    made.mkdir(0o700)
    return made


def announce(folder, arguments, name="r1.json"):
    path = folder / name
    path.touch(0o600)
    path.write_text(json.dumps({"arguments": arguments}))
    return path


def test_what_a_worker_announces_is_served_once(folder):
    Announcement(folder, "r1").write(GOOD, None)
    announcements = Announcements(folder)
    assert announcements.claim() == ("r1", GOOD)
    assert announcements.claim() is None, "a rig has one stack"
    assert not (folder / "r1.json").exists()


def test_a_worker_lets_nobody_else_write_there(tmp_path):
    before = os.umask(0)
    try:
        Announcement(tmp_path / "new" / "rigs", "r1").write(GOOD, None)
    finally:
        os.umask(before)
    assert Announcements(tmp_path / "new" / "rigs").claim() == ("r1", GOOD)


NONSENSE = [
    (b"[]", "no announcement: Expected `object`, got `array`"),
    (b'{"arguments": 5}', "no announcement: Expected `array`"),
    (b'{"arguments": [["--rig"]]}', "no announcement: Expected `str`"),
    (b"{}", "missing required field"),
    (b'{"arguments": [], "run": "id"}', "unknown field"),
    (b"", "no announcement"),
    (b"\xff\xfe\x00", "no announcement"),
    (b"[" * 100_000, "no announcement"),
    (b" " * (FILE_BYTES_MAX + 1), f"at most {FILE_BYTES_MAX} are read"),
    (b'{"arguments": []}', "it announces rig '', its name says r1"),
]


@pytest.mark.parametrize(("data", "words"), NONSENSE)
def test_nonsense_is_told_once_and_served_never(folder, data, words, capfd):
    announce(folder, GOOD, "r2.json").write_bytes(
        json.dumps({"arguments": [w.replace("r1", "r2") for w in GOOD]}).encode()
    )
    bad = announce(folder, GOOD)
    bad.write_bytes(data)
    announcements = Announcements(folder)
    assert announcements.claim()[0] == "r2", "the others are served"
    assert announcements.claim() is None
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"{bad}: ignored: ")
    assert words in line
    assert bad.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([*GOOD, "--join", "/elsewhere"], "option '--join', allowed once each"),
        ([*GOOD, "--key", "/home/me/other.key"], "option '--key'"),
        ([*GOOD, "--commands", ""], "option '--commands'"),
        ([*GOOD, "--stack=os:system", ""], "option '--stack=os:system'"),
        ([*GOOD, "--rig", "r1"], "option '--rig', allowed once"),
        ([*GOOD, "--slots"], "an option and its value in turns"),
        ([*GOOD, "--slots", "1\0"], "an option and its value in turns"),
        ([w.replace("r1", "../r1") for w in GOOD], "its name says r1"),
        (RUNS, "names a command .* start this host with --commands"),
    ],
)
def test_only_options_of_a_rig_are_announced(folder, arguments, words):
    with pytest.raises(UnfitError, match=words):
        read_announcement(announce(folder, arguments), commands=False)


def test_commands_are_for_a_host_that_was_told_so(folder):
    path = announce(folder, RUNS)
    assert Announcements(folder).claim() is None
    assert path.exists(), "a host that may can still take it"
    assert Announcements(folder, commands=True).claim() == ("r1", RUNS)


def shared(path, _folder):
    path.chmod(0o620)


def linked(path, folder):
    path.rename(folder / "real")
    path.symlink_to(folder / "real")


def piped(path, _folder):
    path.unlink()
    os.mkfifo(path, 0o600)


def nested(path, _folder):
    path.unlink()
    path.mkdir()


def endless(path, _folder):
    path.unlink()
    path.symlink_to("/dev/zero")


def given_away(path, _folder):
    os.chown(path, 12345, -1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (shared, "others may write to it"),
        (linked, "a symbolic link"),
        (piped, "a named pipe; a regular file is needed"),
        (nested, "Is a directory"),
        (endless, "a symbolic link"),
        pytest.param(given_away, "belongs to user id 12345", marks=ROOT),
    ],
)
def test_a_file_that_another_may_have_written_is_ignored(folder, change, words, capfd):
    change(announce(folder, GOOD), folder)
    assert Announcements(folder).claim() is None
    (line,) = capfd.readouterr().err.splitlines()
    assert words in line


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_folder_that_others_can_write_to_is_refused(folder, mode):
    announce(folder, GOOD)
    folder.chmod(mode)
    with pytest.raises(UsageError, match=f"others may write to it .*{mode:04o}.*chmod go-w"):
        run_join(folder)


@ROOT
def test_a_folder_of_somebody_else_is_refused_unless_it_is_for_all(folder):
    announce(folder, GOOD)
    os.chown(folder, 12345, -1)
    with pytest.raises(UsageError, match="belongs to user id 12345"):
        run_join(folder)
    theirs = announce(folder, [w.replace("r1", "r0") for w in GOOD], "r0.json")
    os.chown(theirs, 12345, -1)
    folder.chmod(0o1777)
    assert Announcements(folder).claim() == ("r1", GOOD), "as in /tmp: a file's owner counts"
    assert theirs.exists()


def test_a_host_outlives_all_of_it(folder):
    """A real one: no traceback, nothing started but what is to be, and it ends when asked."""
    announce(folder, RUNS, "r1.json")
    for number, (data, _) in enumerate(NONSENSE):
        (folder / f"bad{number}.json").write_bytes(data)
    (folder / "dir.json").mkdir()
    (folder / "a b.json").touch()
    os.mkfifo(folder / "pipe.json")
    late = [w.replace("r1", "zz") for w in GOOD]
    announce(folder, late, "zz.json")
    host = subprocess.Popen(
        [sys.executable, "-m", "devkit", "host", "--join", str(folder)],
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
    )
    said = []
    try:
        while not said or "joining" not in said[-1]:
            said.append(host.stderr.readline())
            assert said[-1], said
    finally:
        host.terminate()
        _, rest = host.communicate(timeout=PATIENCE_S)
    assert host.returncode == 0, rest
    assert said[-1] == "joining zz\n"
    assert "Traceback" not in rest
    ignored = [line for line in said if ": ignored: " in line]
    assert len(ignored) == len(NONSENSE) + 4
    assert not (folder / "pwned").exists()
