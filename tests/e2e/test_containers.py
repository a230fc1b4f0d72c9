"""Campaigns inside real containers.

Always: the runtimes that this machine has, with an image that borrows the host's system. With
CONTAINERS=1 (`make containers`): the image that `hpc image build` makes of nothing but a Debian
base and wheels, built and run by an ordinary user.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from container_images import (
    debian_base,
    ordinary_python,
    ordinary_user,
    python_folders,
    shell_image,
)
from processes import committed, wait_for

from hpc.container import BIN_FOLDER, COMMANDS, Container, prefix, preparation
from hpc.wheels import fill_wheels, source_folder

CHECKOUT = Path(__file__).parents[2]
HERE = "no command {}; install it (Debian: charliecloud; apptainer: see install_apptainer.sh)"


def needs(runtime):
    """Skip where the runtime's command is not on the path."""
    if shutil.which(COMMANDS[runtime]) is None:
        pytest.skip(HERE.format(COMMANDS[runtime]))


def prepared(container, user=(), variables=None):
    """Words before a command, once the image is ready."""
    for words in preparation(container):
        subprocess.run([*user, *words], env=variables, check=True)
    return tuple(prefix(container))


@pytest.fixture(params=["apptainer", "charliecloud"])
def borrowed(request, tmp_path, monkeypatch):
    """Words before a command that run it in an image which borrows the host's system."""
    needs(request.param)
    monkeypatch.setenv("USER", os.environ.get("USER", "root"))  # charliecloud asks for it
    monkeypatch.setenv("APPTAINER_USERNS", "1")  # what an ordinary user gets anyway
    image = shell_image(tmp_path / "image")
    # The home folder stays outside, so the kernels that were compiled before have to be named.
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "warp"
    cache.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("WARP_CACHE_PATH", str(cache))
    binds = (*python_folders(), str(CHECKOUT), str(tmp_path), str(cache))
    return prepared(
        Container(image=str(image), runtime=request.param, binds=binds, folder=str(tmp_path))
    )


def test_the_same_results_inside(marked, quiet, tmp_path, borrowed):
    folder = tmp_path / "c"
    child = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "2", "--slots", "2"),
        *("--out", str(folder), "--output", "json"),
        prefix=borrowed,
    )
    out, err = child.communicate()
    assert child.returncode == 1, err
    assert json.loads(out)["fingerprint"] == quiet["fingerprint"]


def test_sigterm_reaches_the_conductor_inside(marked, tmp_path, borrowed):
    """As a job script forwards it: to the process that it started."""
    folder = tmp_path / "c"
    child = marked.start(
        "conductor", "run", "chaos-16", "--out", str(folder), "--workers", "1", prefix=borrowed
    )
    wait_for(lambda: committed(folder) >= 2, "two cases")
    child.send_signal(signal.SIGTERM)
    _, err = child.communicate()
    assert child.returncode == 75, err
    assert "the same command goes on" in err


def test_variables_of_the_job_come_in_and_those_of_python_do_not(borrowed):
    show = "import os; print(sorted(k for k in os.environ if os.environ[k]))"
    job = {
        "CUDA_VISIBLE_DEVICES": "2",
        "SLURM_JOB_ID": "7",
        "TWIN_PARENT_PID": "1",
        "PYTHONPATH": "/x",
    }
    done = subprocess.run(
        [*borrowed, sys.executable, "-c", show],
        env={**os.environ, **job},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "CUDA_VISIBLE_DEVICES" in done.stdout
    assert "SLURM_JOB_ID" in done.stdout
    assert "TWIN_PARENT_PID" in done.stdout
    assert "PYTHONPATH" not in done.stdout


# --- the real image -----------------------------------------------------------------------------

heavy = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(
        not os.environ.get("CONTAINERS"),
        reason="downloads half a gigabyte and takes minutes; `make containers` runs it",
    ),
]


@pytest.fixture(scope="module")
def travel(tmp_path_factory):
    """A folder that everybody may enter, with somebody ordinary and the project's wheels."""
    for command in ("apptainer", "ch-run", "mmdebstrap"):
        if shutil.which(command) is None:
            pytest.skip(HERE.format(command))
    folder = tmp_path_factory.mktemp("travel")
    for path in (folder, folder.parent, folder.parent.parent):
        path.chmod(0o755)
    (folder / "home").mkdir()
    user, variables = ordinary_user(folder / "home")
    # Fast and large instead of slow and small: the image is used once.
    variables["WARP_CACHE_PATH"] = str(folder / "home" / "kernels")
    variables["APPTAINER_MKSQUASHFS_ARGS"] = "-comp zstd -Xcompression-level 1"
    python = ordinary_python(user, variables)
    if not python:
        pytest.skip("no Python that an ordinary user may run")
    (folder / "wheels").mkdir()
    fill_wheels(source_folder(), folder / "wheels")
    yield folder, user, variables, python
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def image(travel):
    """``hpc image build`` by the ordinary user: a SIF."""
    folder, user, variables, python = travel
    base = debian_base(folder / "home", user, variables)
    done = subprocess.run(
        [
            *(*user, *python, "-m", "hpc", "image", "build", "--base", str(base)),
            *("--wheels", str(folder / "wheels")),
            *("--out", str(folder / "home" / "drivetwin.sif"), "--source", str(CHECKOUT)),
        ],
        env=variables,
        cwd=folder / "home",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


@pytest.fixture(scope="module")
def outside(travel):
    """Fingerprint of the demo campaign on this machine, outside of any container."""
    folder = travel[0] / "outside"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "conductor", "run", "aeb-demo"),
            *("--out", str(folder), "--output", "json"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    return json.loads(done.stdout)["fingerprint"]


def demo_inside(travel, container):
    """The demo campaign inside, by the ordinary user; its fingerprint."""
    _, user, variables, _ = travel
    words = prepared(container, user, variables)
    done = subprocess.run(
        [
            *(*user, *words, f"{BIN_FOLDER}/conductor", "run", "aeb-demo"),
            *("--out", f"{container.folder}/{container.runtime}", "--output", "json"),
        ],
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    folder = Path(container.folder) / container.runtime
    assert (folder / "report.html").stat().st_size > 10_000
    if user:
        assert {path.stat().st_uid for path in folder.rglob("*")} == {65534}
    return json.loads(done.stdout)["fingerprint"]


class TestTheRealImage:
    """Built and entered by somebody without rights."""

    pytestmark = heavy

    def test_apptainer(self, travel, image, outside):
        home = str(travel[0] / "home")
        found = demo_inside(travel, Container(image=str(image), binds=(home,), folder=home))
        assert found == outside

    def test_charliecloud(self, travel, image, outside):
        folder, user, variables, _ = travel
        home = str(folder / "home")
        unpacked = f"{home}/image"
        subprocess.run(
            [*user, "apptainer", "build", "--sandbox", unpacked, str(image)],
            env=variables,
            check=True,
        )
        container = Container(image=unpacked, runtime="charliecloud", binds=(home,), folder=home)
        assert demo_inside(travel, container) == outside
