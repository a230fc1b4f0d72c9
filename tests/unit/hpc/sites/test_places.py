"""Programs at other places, and submissions that are done once."""

import signal
import subprocess
import sys

import pytest
from waiting import wait_for

from hpc.commands import CODE_UNKNOWN, Place, UnknownOutcomeError, at, call, exists, write_there
from twin.base.errors import InfrastructureError

SH = ("sh", "-c")
ODD = "a b'c\"d;$(touch x)`id`\n*"


def test_words_and_folders_arrive_as_they_are(tmp_path):
    folder = tmp_path / "o'd d"
    folder.mkdir()
    with at(Place(reach=SH)):
        done = call("printf", "%s", ODD, folder=folder)
        where = call("pwd", folder=folder)
    assert done.out == ODD
    assert where.out == f"{folder}\n"
    assert not (folder / "x").exists()


def test_a_line_for_another_shell_is_one_word():
    """As ``ssh`` does it: the line is parsed once more over there."""
    with at(Place(reach=("env", "sh", "-c", 'exec sh -c "$0"'))):
        assert call("printf", "%s", ODD).out == ODD


def test_programs_are_looked_for_there():
    with at(Place(reach=("env", "PATH=/nowhere", "/bin/sh", "-c"))):
        assert not exists("sh")
    with at(Place(reach=SH)):
        assert exists("sh")
    assert exists("sh")


def test_files_are_written_there_and_their_content_is_in_no_command_line(tmp_path):
    seen = tmp_path / "seen"
    spy = f'tr "\\0" " " < /proc/$$/cmdline >> {seen}; exec sh -c "$0"'
    path = tmp_path / "a" / "b c" / "worker.key"
    with at(Place(reach=("sh", "-c", spy))):
        write_there(str(path), b"SECRET\n", 0o600)
    assert path.read_bytes() == b"SECRET\n"
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert "worker.key" in seen.read_text()
    assert "SECRET" not in seen.read_text()


def test_a_file_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with at(Place(reach=SH)), pytest.raises(InfrastructureError, match="cannot be written there"):
        write_there(str(tmp_path / "file" / "x"), b"", 0o600)


def test_a_host_that_is_not_reached():
    with (
        at(Place(reach=("sh", "-c", "echo 'ssh: no route to host' >&2; exit 255", "login"))),
        pytest.raises(InfrastructureError, match="not reached: ssh: no route to host"),
    ):
        call("sbatch")


def submission(folder, text, reach=()):
    """A program ``submit`` that counts how often it was run."""
    program = folder / "submit"
    program.write_text(f"#!/bin/sh\necho run >> {folder}/runs\n{text}\n")
    program.chmod(0o755)
    return Place(reach=reach, once=str(folder), submits=str(program)), str(program)


@pytest.mark.parametrize("reach", [(), SH])
def test_once(tmp_path, reach):
    place, program = submission(tmp_path, "echo 17; echo note >&2; exit 3", reach)
    for _ in range(3):
        with at(place):
            done = call(program, "job.sh", folder=tmp_path)
        assert (done.code, done.out, done.err) == (3, "17\n", "note\n")
    assert (tmp_path / "runs").read_text() == "run\n"


def test_other_programs_run_every_time(tmp_path):
    place, _ = submission(tmp_path, "exit 0")
    for _ in range(2):
        with at(place):
            assert call("sh", "-c", f"echo x >> {tmp_path}/other").code == 0
    assert (tmp_path / "other").read_text() == "x\nx\n"


def test_whoever_asks_may_be_killed_in_the_middle(tmp_path):
    """The submission goes on without him, and its answer is there for who asks again."""
    place, program = submission(
        tmp_path,
        f"touch {tmp_path}/began; until [ -e {tmp_path}/go ]; do sleep 0.02; done; echo 18",
    )
    text = (
        "import sys; from pathlib import Path; from hpc.commands import Place, at, call\n"
        "with at(Place(once=sys.argv[1], submits=sys.argv[2])):\n"
        "    call(sys.argv[2], folder=Path(sys.argv[1]))"
    )
    asker = subprocess.Popen([sys.executable, "-c", text, str(tmp_path), program])
    wait_for((tmp_path / "began").exists, "the submission")
    asker.send_signal(signal.SIGKILL)
    asker.wait()
    (tmp_path / "go").touch()
    with at(place):
        assert call(program, folder=tmp_path).out == "18\n"
    assert (tmp_path / "runs").read_text() == "run\n"


def test_a_host_that_died_in_the_middle(tmp_path, monkeypatch):
    place, program = submission(tmp_path, "echo 19")
    monkeypatch.setattr("hpc.commands.ONCE_TRIES", 2)
    (tmp_path / ".submitting").mkdir()
    with at(place), pytest.raises(UnknownOutcomeError, match="is not known"):
        call(program, folder=tmp_path)
    assert not (tmp_path / "runs").exists()
    assert CODE_UNKNOWN == 70
