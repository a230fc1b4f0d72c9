"""Stacks in a git repository and in a container: the same values as the same stack right here."""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest
from container_images import missing, python_folders, shell_image
from foreign_campaigns import CLIENT, campaign, python
from processes import outcomes

from hpc.software.container import COMMANDS
from twin.sandbox.possible import why_not

MATRIX = {"matrix": {"weather": ["clear", "heavy_fog"]}}


def git(folder, *words):
    who = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def bare(tmp_path):
    """A bare clone of a repository that holds the client."""
    source = tmp_path / "source"
    source.mkdir()
    shutil.copy(CLIENT, source / "client.py")
    (source / "build.sh").write_text("mkdir bin && cp client.py bin/stack.py && echo built\n")
    git(source, "init", "--quiet", "--initial-branch", "main")
    git(source, "add", ".")
    git(source, "commit", "--quiet", "--message", "first")
    git(tmp_path, "clone", "--quiet", "--bare", "source", "stack.git")
    shutil.rmtree(source)
    return tmp_path / "stack.git"


def run(marked, path, *options):
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "1", "--output", "json"),
        *("--out", str(path.parent / f"run-{path.stem}"), *options),
    )
    return done, path.parent / f"run-{path.stem}"


def fingerprint(marked, path):
    done, _ = run(marked, path)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["fingerprint"]


def test_a_stack_in_a_repository(marked, bare, tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    repository = {"url": str(bare), "ref": "main", "setup": "sh build.sh"}
    driver = {"command": [*python("bin/stack.py")], "repository": repository}
    here = campaign(tmp_path, "here", {"command": python(CLIENT)}, **MATRIX)
    there = campaign(tmp_path, "there", driver, **MATRIX)
    first = fingerprint(marked, there)
    assert first == fingerprint(marked, here)
    record = json.loads((tmp_path / "run-there/outcomes.json").read_text())
    assert record["protection"] == ["default"] or why_not()
    (entry,) = (tmp_path / "cache/repositories").glob("*/tree")
    made_ns = entry.stat().st_mtime_ns
    assert not (entry / "bin/stack.py").stat().st_mode & 0o222
    # Once fetched, it is found without the repository, by its commit.
    commit = json.loads((entry.parent / "input.json").read_text())["commit"]
    bare.rename(tmp_path / "gone.git")
    again = campaign(
        *(tmp_path, "again", {**driver, "repository": {**repository, "ref": commit}}), **MATRIX
    )
    assert fingerprint(marked, again) == first
    assert entry.stat().st_mtime_ns == made_ns


def test_a_check_runs_nothing_of_a_repository(marked, bare, tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    repository = {"url": str(bare), "ref": "main", "setup": f"touch {tmp_path}/was-run"}
    path = campaign(tmp_path, "checked", {"command": ["x"], "repository": repository})
    done = marked.run("conductor", "validate", str(path))
    assert done.returncode == 0, done.stderr
    assert f"then `touch {tmp_path}/was-run` is run there; --fetch does so now" in done.stdout
    assert not (tmp_path / "cache").exists()
    done = marked.run("conductor", "validate", "--fetch", str(path))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "was-run").exists()
    assert "is run there" not in done.stdout


def test_a_repository_that_cannot_be_used_is_told_at_once(marked, bare, tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    setup = "echo step one; echo step two; echo no compiler here >&2; exit 3"
    for name, change, lines in (
        ("setup", {"setup": setup}, ("exit code 3: no compiler here; what it said is in",)),
        ("ref", {"ref": "mian"}, ("no branch, tag or commit 'mian'", "main")),
        ("url", {"url": str(tmp_path / "nothing.git")}, ("does not exist",)),
    ):
        repository = {"url": str(bare), "ref": "main", **change}
        path = campaign(tmp_path, name, {"command": ["x"], "repository": repository})
        done, _ = run(marked, path)
        assert done.returncode == 2, done.stderr
        for line in ("autonomy.repository: ", *lines):
            assert line in done.stderr
    (log,) = (tmp_path / "cache/repositories").glob("*.log")
    text = log.read_text()
    assert "step one\nstep two\nno compiler here\nexit code 3\n" in text


@pytest.mark.parametrize("runtime", ["charliecloud", "apptainer"])
def test_a_stack_in_a_container(marked, tmp_path, runtime, monkeypatch):
    if reason := missing(COMMANDS[runtime]):
        pytest.skip(reason)
    monkeypatch.setenv("APPTAINER_USERNS", "1")  # what an ordinary user gets anyway
    image = {
        "path": str(shell_image(tmp_path / "image")),
        "runtime": runtime,
        "binds": [*python_folders(), str(CLIENT.parent)],
    }
    here = campaign(tmp_path, "here", {"command": python(CLIENT)}, **MATRIX)
    inside = campaign(tmp_path, "inside", {"command": python(CLIENT), "image": image}, **MATRIX)
    assert fingerprint(marked, inside) == fingerprint(marked, here)
    record = json.loads((tmp_path / "run-inside/outcomes.json").read_text())
    assert record["protection"] == ["default"] or why_not()


@pytest.fixture
def precious():
    """A folder of the host, outside of all that a container is shown."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        yield Path(folder)


@pytest.mark.parametrize("runtime", ["charliecloud", "apptainer"])
def test_a_container_forbids_to_write_outside(marked, tmp_path, precious, runtime, monkeypatch):
    if reason := missing(COMMANDS[runtime]):
        pytest.skip(reason)
    monkeypatch.setenv("APPTAINER_USERNS", "1")
    root = shell_image(tmp_path / "image")
    words = f"for file in {precious}/a /written; do echo evil > $file; done; exit 9"
    image = {"path": str(root), "runtime": runtime, "binds": python_folders()}
    driver = {"command": ["sh", "-c", words], "image": image}
    done, folder = run(marked, campaign(tmp_path, "writes", driver, attempts_max=1))
    assert done.returncode == 1, done.stderr
    (case,) = outcomes(folder).values()
    assert "exit code 9" in " ".join(case["reasons"])
    assert "cannot create /written: Read-only file system" in " ".join(case["reasons"])
    assert not (root / "written").exists()
    assert list(precious.iterdir()) == []


def test_images_that_cannot_be_used_have_their_reason(marked, tmp_path):
    driver = {"command": ["x"], "image": {"path": str(tmp_path / "no.sif")}}
    done, _ = run(marked, campaign(tmp_path, "missing", driver))
    assert done.returncode == 2
    assert "autonomy.image.path: " in done.stderr
    assert "no.sif: no such file or folder" in done.stderr
    driver = {"command": ["x"], "image": {"path": "org/name:1", "runtime": "podman"}}
    done, folder = run(marked, campaign(tmp_path, "podman", driver, attempts_max=1))
    if not missing(COMMANDS["podman"]):
        pytest.skip("podman is here; it would look for the image in the network")
    assert done.returncode == 3
    (case,) = outcomes(folder).values()
    assert "`podman` cannot be run: No such file" in " ".join(case["reasons"])
