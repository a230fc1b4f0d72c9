"""Edges of the main job: where it runs, who runs it, and what its output goes to."""

import os
import pty
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from kernel_folders import LEFT_OUT, all_but_one, compiled_in
from processes import catches, interrupt, outcomes, wait_for

ROOT = Path(__file__).resolve().parents[2]
HIT = "yolov3-0500-heavy_rain"
"""A case of chaos-16 that ends in a collision."""


def run(marked, folder, *options, variables=None):
    """chaos-16 into ``folder`` with further environment variables."""
    old = dict(os.environ)
    os.environ.update(variables or {})
    try:
        return marked.run("conductor", "run", "chaos-16", "--out", str(folder), *options)
    finally:
        os.environ.clear()
        os.environ.update(old)


def test_a_path_with_spaces_and_umlauts(marked, quiet, tmp_path):
    """Its output goes to no terminal: plain lines."""
    folder = tmp_path / "my runs (2)" / "größe $HOME"
    done = run(marked, folder, "--workers", "1", "--slots", "4")
    assert done.returncode == 1, done.stderr
    assert quiet["fingerprint"] in done.stdout
    assert str(folder / "report.html") in done.stdout
    assert len(outcomes(folder)) == 16
    assert "\x1b" not in done.stdout + done.stderr
    assert "\r" not in done.stdout + done.stderr
    assert "chaos-16: 16 of 16 cases done" in done.stderr


def test_json_output_is_one_object(quiet):
    assert len(quiet["stdout"].strip().splitlines()) == 1
    assert quiet["stdout"].startswith('{"campaign": "chaos-16"')


def test_a_dumb_terminal(marked, tmp_path):
    """On a terminal without cursor movement: no escape sequences, and it ends."""
    leader, follower = pty.openpty()
    command = [sys.executable, "-m", "conductor", "run", "chaos-16", "--case", HIT]
    command += ["--out", str(tmp_path / "c")]
    variables = {**os.environ, "TERM": "dumb"}
    with subprocess.Popen(command, stdout=follower, stderr=follower, env=variables) as child:
        os.close(follower)
        text = b""
        while True:
            try:
                data = os.read(leader, 65536)
            except OSError:  # the other end is closed
                break
            if not data:
                break
            text += data
    os.close(leader)
    assert child.returncode == 1
    assert b"\x1b" not in text
    assert b"fingerprint" in text


def test_stdout_that_is_closed_early(marked, tmp_path):
    child = subprocess.Popen(
        f"{sys.executable} -m conductor campaigns | true",
        shell=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    _, err = child.communicate()
    assert "Traceback" not in err
    assert "Exception" not in err


@pytest.fixture
def read_only(tmp_path):
    """A folder on a file system that is mounted read-only."""
    folder = tmp_path / "ro"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "ro,size=1m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs root to mount a read-only file system")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_read_only_folder(marked, read_only):
    done = run(marked, read_only / "c")
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert str(read_only / "c") in line
    assert "Read-only file system" in line
    assert "--out" in line


def test_a_file_where_the_folder_should_be(marked, tmp_path):
    path = tmp_path / "c"
    path.write_text("mine")
    done = run(marked, path)
    assert done.returncode in (2, 3)
    assert len(done.stderr.strip().splitlines()) == 1
    assert path.read_text() == "mine"


def test_no_write_access_to_the_kernel_cache(marked, quiet, read_only, tmp_path):
    """Kernels come from a private folder below the temporary one instead; what it lacks is compiled
    into it."""
    own = marked.temporary / f"drivetwin-kernels-{os.getuid()}"
    place = all_but_one(own)
    own.chmod(0o700)
    variables = {"WARP_CACHE_PATH": str(read_only / "warp")}
    done = run(marked, tmp_path / "c", "--workers", "1", "--slots", "4", variables=variables)
    assert done.returncode == 1, done.stderr
    assert quiet["fingerprint"] in done.stdout
    (compiled,) = compiled_in(place)
    assert compiled.startswith(LEFT_OUT)
    assert list(marked.temporary.iterdir()) == [own]
    shutil.rmtree(own)


def test_no_write_access_as_another_user(marked, tmp_path):
    """An ordinary user and a folder of root's."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("needs root and the Debian package util-linux")
    folder = Path("/root/drivetwin-test-not-yours")
    command = ["setpriv", "--reuid", "65534", "--clear-groups", sys.executable]
    probe = subprocess.run([*command, "-c", "import conductor.cli"], capture_output=True)
    if probe.returncode:
        pytest.skip("other users cannot read this checkout")
    child = marked.start(
        *("conductor", "run", "chaos-16", "--out", str(folder)),
        prefix=("setpriv", "--reuid", "65534", "--clear-groups"),
    )
    _, err = child.communicate()
    assert child.returncode == 2
    assert len(err.strip().splitlines()) == 1
    assert "Permission denied" in err


def test_two_runs_side_by_side_and_one_too_many(marked, quiet, tmp_path):
    """Two folders at the same time; a third run in a folder that is in use is refused."""
    command = ("conductor", "run", "chaos-16", "--workers", "1", "--slots", "2", "--out")
    runs = [marked.start(*command, str(tmp_path / name)) for name in "ab"]
    wait_for(lambda: (tmp_path / "a" / "conductor.json").exists(), "the first conductor")
    refused = marked.run(*command, str(tmp_path / "a"))
    assert refused.returncode == 2
    assert str(runs[0].pid) in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1
    for child in runs:
        out, err = child.communicate()
        assert child.returncode == 1, err
        assert quiet["fingerprint"] in out


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.3, 0.8, 1.5])
def test_sigterm_at_every_stage(marked, tmp_path, after_s):
    """Wherever it hits: 75, one line, nothing left. A job is queued again for that code alone."""
    out = tmp_path / "c"
    child = marked.start("conductor", "run", "chaos-16", "--case", HIT, "--out", str(out))
    wait_for(lambda: catches(child.pid, signal.SIGTERM), "its first lines")
    with suppress(subprocess.TimeoutExpired):
        child.wait(after_s)
    child.terminate()
    _, err = child.communicate()
    assert child.returncode == 75, err
    assert "goes on" in err or "to go on" in err
    assert "Traceback" not in err
    wait_for(lambda: not marked.processes(), "the end of every process")
    if not (out / "conductor.db").exists():
        assert not out.exists(), "it had not begun"


@pytest.mark.parametrize("after_s", [0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.5])
def test_ctrl_c_at_every_stage(marked, tmp_path, after_s):
    """Wherever it hits: 130, no traceback, nothing left, and the next run finishes.

    A single case, since what is in the way is the start.
    """
    command = ("conductor", "run", "chaos-16", "--case", HIT, "--out", str(tmp_path / "c"))
    child = marked.start(*command)
    wait_for(lambda: marked.processes("run"), "the process")
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(after_s)
    interrupt(child)
    _, err = child.communicate()
    assert child.returncode in (130, -signal.SIGINT), err  # the latter while modules load
    # On a crowded machine Python itself may still be starting: what it says then names no file of
    # ours but the package's first.
    ours = [line for line in err.splitlines() if str(ROOT) in line and "__.py" not in line]
    assert "Traceback" not in err or not ours, err
    again = marked.run(*command)
    assert again.returncode == 1, again.stderr
    assert len(outcomes(tmp_path / "c")) == 1


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_other_pythons(marked, quiet, tmp_path, version):
    """A fresh clone, its own environment, the same verdicts."""
    if f"{sys.version_info.major}.{sys.version_info.minor}" == version:
        pytest.skip(f"the other tests run on Python {version}")
    found = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python3"))
    python = str(found[-1]) if found else shutil.which(f"python{version}")
    if python is None:
        pytest.skip(f"needs python{version} (Debian, or pyenv)")
    environment = tmp_path / "venv"
    subprocess.run([python, "-m", "venv", str(environment)], check=True)
    subprocess.run(
        [
            *(environment / "bin" / "pip", "install", "--quiet", "--disable-pip-version-check"),
            "--no-compile",  # what runs is compiled when it runs
            *("--constraint", str(ROOT / "constraints.txt"), str(ROOT)),
        ],
        check=True,
        capture_output=True,
    )
    done = subprocess.run(
        [
            *(environment / "bin" / "conductor", "run", "chaos-16", "--out", str(tmp_path / "c")),
            *("--workers", "1", "--slots", "4"),
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 1, done.stderr
    assert quiet["fingerprint"] in done.stdout
