"""Software that travels: the bundle and the image, as compute nodes without internet get them.

With OFFLINE=1 only (`make offline`): it downloads half a gigabyte and takes minutes.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from container_images import debian_base, missing, ordinary_python, ordinary_user, prepared

from hpc.software.container import BIN_FOLDER, Container

CHECKOUT = Path(__file__).parents[2]
ALONE = ("unshare", "--map-root-user", "--net", "sh", "-c", 'ip link set lo up; exec "$@"', "sh")
"""Before a command: it sees no network but a loopback of its own."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(
        not os.environ.get("OFFLINE"),
        reason="downloads half a gigabyte and takes minutes; `make offline` runs it",
    ),
]


def run(*words, codes=(0,), **options):
    """Run to the end; standard output."""
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert done.returncode in codes, done.stderr
    return done.stdout


def fingerprint(text):
    """Of a run with ``--output json``."""
    return json.loads(text)["fingerprint"]


@pytest.fixture(scope="module")
def travel():
    """A folder that everybody may enter (pytest closes its own), with a folder ``home``."""
    folder = Path(tempfile.mkdtemp(prefix="travel-"))
    folder.chmod(0o755)
    (folder / "home").mkdir()
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def bundle(travel):
    """``hpc bundle``."""
    out = travel / "bundle"
    words = (sys.executable, "-m", "hpc", "bundle", "--campaign", "aeb-fusion")
    run(*words, "--out", str(out), "--source", str(CHECKOUT))
    assert {path.name for path in out.iterdir()} == {
        *("constraints.txt", "install.sh", "kernels", "wheels")
    }
    return out


def kernels(folder):
    """Compiled kernels in a cache."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*.o"))


def test_install_and_run_without_a_network(quiet, travel, bundle):
    assert subprocess.run([*ALONE, "getent", "hosts", "debian.org"], check=False).returncode
    cache = travel / "kernels"
    variables = {**os.environ, "WARP_CACHE_PATH": str(cache), "PYTHON": sys.executable}
    variables["PATH"] = "/usr/bin:/bin:/usr/sbin:/sbin"
    variables.pop("PYTHONPATH", None)
    venv = travel / "venv"
    run(*ALONE, str(bundle / "install.sh"), str(venv), env=variables)
    before = kernels(cache)
    assert before
    assert before == kernels(bundle / "kernels")
    found = run(
        *(*ALONE, str(venv / "bin" / "conductor"), "run", "chaos-16", "--workers", "2"),
        *("--out", str(travel / "chaos"), "--output", "json"),
        codes=(1,),
        env=variables,
        cwd=travel,
    )
    assert fingerprint(found) == quiet["fingerprint"]
    case = ("run", "aeb-fusion", "--cases", "1", "--workers", "1", "--out", str(travel / "case"))
    run(*ALONE, str(venv / "bin" / "conductor"), *case, codes=(0, 1), env=variables, cwd=travel)
    assert kernels(cache) == before, "nothing had to be compiled"


@pytest.fixture(scope="module")
def somebody(travel):
    """Words before a command, and variables: somebody without rights, in the folder ``home``."""
    user, variables = ordinary_user(travel / "home")
    variables["WARP_CACHE_PATH"] = str(travel / "home" / "kernels")
    return user, variables


@pytest.fixture(scope="module")
def image(travel, bundle, somebody):
    """``hpc image build`` by somebody ordinary: a SIF of a Debian base and the bundle's wheels."""
    if reason := missing("apptainer", "ch-run", "mmdebstrap"):
        pytest.skip(reason)
    user, variables = somebody
    python = ordinary_python(user, variables)
    if not python:
        pytest.skip("no Python of this version that an ordinary user may run")
    base = debian_base(travel / "home", user, variables)
    # Fast and large instead of slow and small: the image is used twice.
    quick = {"APPTAINER_MKSQUASHFS_ARGS": "-comp zstd -Xcompression-level 1"}
    found = run(
        *(*user, *python, "-m", "hpc", "image", "build", "--base", str(base)),
        *("--wheels", str(bundle / "wheels"), "--source", str(CHECKOUT)),
        *("--out", str(travel / "home" / "drivetwin.sif")),
        env={**variables, **quick},
        cwd=travel / "home",
    )
    return Path(found.strip())


@pytest.fixture(scope="module")
def outside(travel):
    """Fingerprint of the demo campaign on this machine, outside of any container."""
    words = (sys.executable, "-m", "conductor", "run", "aeb-demo", "--output", "json")
    return fingerprint(run(*words, "--out", str(travel / "outside"), codes=(0, 1)))


def demo_inside(somebody, container):
    """The demo campaign inside, by somebody ordinary; its fingerprint."""
    user, variables = somebody
    words = prepared(container, user, variables)
    folder = Path(container.folder) / container.runtime
    found = run(
        *(*user, *words, f"{BIN_FOLDER}/conductor", "run", "aeb-demo"),
        *("--out", str(folder), "--output", "json"),
        codes=(0, 1),
        env=variables,
    )
    assert (folder / "report.html").stat().st_size > 10_000
    owner = os.getuid() or 65534
    assert {path.stat().st_uid for path in folder.rglob("*")} == {owner}
    return fingerprint(found)


def test_the_demo_in_an_apptainer_image(somebody, image, outside):
    home = str(image.parent)
    assert demo_inside(somebody, Container(image=str(image), binds=(home,), folder=home)) == outside


def test_the_demo_under_charliecloud(somebody, image, outside):
    user, variables = somebody
    home = str(image.parent)
    unpacked = f"{home}/image"
    run(*user, "apptainer", "build", "--sandbox", unpacked, str(image), env=variables)
    container = Container(image=unpacked, runtime="charliecloud", binds=(home,), folder=home)
    assert demo_inside(somebody, container) == outside
