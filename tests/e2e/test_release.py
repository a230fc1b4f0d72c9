"""What `make dist` makes: archives with the same bytes each time, which install and run without
this checkout, git and make."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
import yaml
from waiting import wait_for

ROOT = Path(__file__).parents[2]
TOOLS = {"PYTHONPATH": str(ROOT / "tests")}
WORKER_BYTES_MAX = 700_000_000
"""What an installation of the workers' distribution may take; 633 MB when this was written, of
which Warp, NumPy and Zenoh are 481."""
ABSENT = {"rerun_bindings", "plotly", "matplotlib", "jinja2", "pyarrow", "cv2"}
ABSENT |= {"viewer", "conductor"}
"""Packages that it is without."""
CAMPAIGN = """\
campaign: one
camera: {width: 64, height: 36, hz: 20}
scenario: {duration_s: 1}
autonomy: {perception: {truth: {type: ground_truth}}}
matrix: {model: [truth]}
"""


def call(*words: str, folder: Path = ROOT, code: int | None = 0, **changed: str) -> str:
    """What a program prints; it must end with ``code``, unless that is None."""
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, env={**os.environ, **changed}
    )
    assert code in (done.returncode, None), (words, done.stdout[-1000:], done.stderr[-3000:])
    return done.stdout + done.stderr


@pytest.fixture(scope="session")
def dist(tmp_path_factory):
    """The folder that `make dist` fills, made once for all processes."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = shared / "dist"
    with (shared / "dist.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "SHA256SUMS").exists():
            call(sys.executable, "-m", "release.build", "--out", str(folder), **TOOLS)
    return folder


def environment(dist: Path, pattern: str, folder: Path, *options: str) -> tuple[Path, str]:
    """An environment with the wheel and what it declares, and what was printed about its size."""
    wheel = str(next(dist.glob(pattern)))
    words = (sys.executable, "-m", "release.environment", wheel, str(folder), *options)
    return folder / "bin", call(*words, **TOOLS)


def path_without(folder: Path, *names: str) -> str:
    """A folder with every program of this machine but some, for ``PATH``."""
    folder.mkdir()
    for place in ("/usr/local/bin", "/usr/bin", "/bin"):
        for program in Path(place).glob("*"):
            if program.name not in names and not (folder / program.name).is_symlink():
                (folder / program.name).symlink_to(program)
    return str(folder)


def test_everything_is_there_and_summed(dist):
    lines = (dist / "SHA256SUMS").read_text().splitlines()
    sums = dict(reversed(line.split("  ")) for line in lines)
    kinds = {name.partition("-")[0] + name[-7:] for name in sums}
    assert kinds == {
        *("drivetwindx.json", "drivetwin.tar.gz", "drivetwinany.whl", "drivetwin_workerany.whl")
    }
    for name, digest in sums.items():
        assert hashlib.sha256((dist / name).read_bytes()).hexdigest() == digest


def test_sdist_and_tree_build_the_same_wheel(dist, tmp_path):
    """Built from the files of the sdist at another time and place, by somebody with another umask,
    the wheel has the same bytes."""
    with tarfile.open(next(dist.glob("*.tar.gz"))) as archive:
        archive.extractall(tmp_path, filter="data")
    tree = next(tmp_path.iterdir())
    for path in tree.rglob("*.py"):
        os.utime(path, (1, 1))
        path.chmod(0o600)
    out = tmp_path / "out"
    build = (sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(out))
    call(*build, str(tree), folder=tree)
    ours = next(dist.glob("drivetwin-*.whl"))
    assert (out / ours.name).read_bytes() == ours.read_bytes()
    shutil.rmtree(out)
    call(*build, str(ROOT))
    assert (out / ours.name).read_bytes() == ours.read_bytes()
    for name in ("Makefile", "constraints.txt", "tests/conftest.py", "tests/release/build.py"):
        assert (tree / name).is_file(), "the sdist can be tested and released again"


def test_the_demo_report_in_two_commands_without_git_and_make(dist, tmp_path):
    bin_folder, _ = environment(dist, "drivetwin-*.whl", tmp_path / "env")
    path = path_without(tmp_path / "programs", "git", "make", "gmake")
    assert shutil.which("git", path=path) is None
    assert shutil.which("sh", path=path)
    changed = {"PATH": f"{bin_folder}:{path}", "PYTHONPATH": ""}
    run = (str(bin_folder / "conductor"), "run", "aeb-demo", "--cases", "1", "--workers", "1")
    said = call(*run, folder=tmp_path, **changed)
    assert "1 of 1 passed" in said
    report = tmp_path / "runs" / "aeb-demo" / "report.html"
    assert "plotly" in report.read_text()
    where = call(
        *(str(bin_folder / "python"), "-c", "import conductor; print(conductor.__file__)"),
        folder=tmp_path,
        **changed,
    )
    assert where.startswith(str(tmp_path)), "what ran is what was installed"
    listed = call(str(bin_folder / "drivetwin"), folder=tmp_path, **changed)
    assert listed.count("\n") >= 5


def test_the_workers_distribution_runs_a_case_and_is_smaller(dist, tmp_path):
    bin_folder, said = environment(dist, "drivetwin_worker-*.whl", tmp_path / "env")
    print(said)
    lines = {line.split("MB")[1].split(",")[0].strip(): line for line in said.splitlines()}
    assert float(lines["in all"].split()[0]) * 1e6 < WORKER_BYTES_MAX
    site = next((tmp_path / "env" / "lib").glob("python*/site-packages"))
    assert not ABSENT & {path.name for path in site.iterdir()}
    state = tmp_path / "state"
    changed = {"PYTHONPATH": "", "PATH": f"{bin_folder}:{os.environ['PATH']}"}
    campaign = tmp_path / "one.yaml"
    campaign.write_text(CAMPAIGN)
    conductor = [sys.executable, "-m", "conductor"]
    serving = subprocess.Popen(
        [*conductor, "serve", "--state", str(state), "--campaign", str(campaign), "--until-done"],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        listens = (state / "conductor.json").exists
        wait_for(lambda: listens() or serving.poll() is not None, "a conductor that listens")
        assert listens(), serving.communicate()
        worker = (str(bin_folder / "twin"), "worker", "--state", str(state), "--until-done")
        call(*worker, folder=tmp_path, **changed)
        _, complained = serving.communicate(timeout=300)
    finally:
        serving.kill()
        serving.wait()
    assert serving.returncode in (0, 1), complained
    outcomes = json.loads((state / "outcomes.json").read_text())
    assert "unresolved" not in json.dumps(outcomes)
    judged = call(sys.executable, "-m", "twin", "judge", str(state))
    assert "1 agree" in judged, "what it wrote, pyarrow reads"


def test_what_the_workers_distribution_lacks_is_one_line_at_use(dist, tmp_path):
    bin_folder, _ = environment(dist, "drivetwin_worker-*.whl", tmp_path / "env")
    changed = {"PYTHONPATH": ""}
    needs = {
        ("validate", "vehicle", "opencav", "--out", "page"): "this needs the package ",
        ("judge", "."): "this needs the package pyarrow, ",
        ("snapshot",): "this needs the package cv2, ",
        ("worker", "--view", "record"): "--view record: recordings need the package viewer, ",
    }
    for words, wanted in needs.items():
        said = call(str(bin_folder / "twin"), *words, folder=tmp_path, code=2, **changed)
        assert said.strip().splitlines()[-1].startswith(f"twin: {wanted}"), said
        assert re.search("pip install '?drivetwin", said)
        assert "Traceback" not in said


def test_both_distributions_have_the_same_software_digest(dist, tmp_path):
    """With OpenCV and without: their workers share campaigns."""
    code = (
        "import importlib.util as u, twin.base.software as s\n"
        "print(u.find_spec('cv2') is None, s.software_digest(), s.device_class('cpu'))"
    )
    wheels = {
        "all": ("drivetwin-*.whl",),
        "slim": ("drivetwin_worker-*.whl",),
        "networks": ("drivetwin_worker-*.whl", "--extra", "networks"),
    }
    said = {}
    for name, (pattern, *options) in wheels.items():
        bin_folder, _ = environment(dist, pattern, tmp_path / name, *options)
        python = str(bin_folder / "python")
        said[name] = call(python, "-c", code, folder=tmp_path, PYTHONPATH="").split()
    assert {name: words[0] for name, words in said.items()} == {
        "all": "False",
        "slim": "True",
        "networks": "False",
    }
    assert said["all"][1:] == said["slim"][1:] == said["networks"][1:]


@pytest.mark.parametrize(
    ("lacking", "wanted", "package"),
    [
        ({"view": "record"}, "writes no recordings", "viewer: pip uninstall drivetwin-worker, "),
        (
            {"autonomy": {"perception": {"truth": {"type": "network", "model": "yolov3-w25"}}}},
            "cannot run the perception ",
            "cv2: pip install 'drivetwin-worker[networks]'",
        ),
    ],
    ids=["recording", "network"],
)
def test_the_workers_distribution_gets_no_case_for_which_it_lacks_something(
    dist, tmp_path, lacking, wanted, package
):
    bin_folder, _ = environment(dist, "drivetwin_worker-*.whl", tmp_path / "env")
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(yaml.safe_load(CAMPAIGN) | lacking))
    state = tmp_path / "state"
    serve = [sys.executable, "-m", "conductor", "serve", "--state", str(state), "--until-done"]
    serve += ["--campaign", str(tmp_path / "one.yaml")]
    work = [str(bin_folder / "twin"), "worker", "--state", str(state)]
    listens = (state / "conductor.json").exists
    started = []
    logs = [tmp_path / "conductor.log", tmp_path / "worker.log"]
    try:
        for words, log, folder in zip((serve, work), logs, (ROOT, tmp_path), strict=True):
            path = {"PYTHONPATH": str(ROOT) if words is serve else ""}
            with log.open("w") as stderr:
                process = subprocess.Popen(
                    words, cwd=folder, stdout=stderr, stderr=stderr, env={**os.environ, **path}
                )
            started.append(process)
            wait_for(lambda: listens() or started[0].poll() is not None, "a conductor that listens")
        wait_for(
            lambda: (
                "it gets no case of campaign 'one'" in logs[0].read_text()
                or any(process.poll() is not None for process in started)
            ),
            "a conductor that says why",
        )
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()
    for log in logs:
        said = [line for line in log.read_text().splitlines() if wanted in line]
        assert said, log.read_text()
        assert f"no package {package}" in said[0]
    assert not list(state.glob("cases/*")), "nothing was leased"


def test_both_distributions_in_one_environment_are_told_apart(dist, tmp_path):
    """The doctor says how to get out of it, and that works."""
    bin_folder, _ = environment(dist, "drivetwin-*.whl", tmp_path / "env")
    pip = [sys.executable, "-m", "pip", "--python", str(bin_folder / "python")]
    install = (*pip, "install", "--quiet", "--no-index", "--no-deps", "--no-compile")
    call(*install, str(next(dist.glob("drivetwin_worker-*.whl"))))
    doctor = (str(bin_folder / "conductor"), "doctor", "--out", str(tmp_path), "--output", "json")
    found = json.loads(call(*doctor, folder=tmp_path, code=3, PYTHONPATH=""))
    (line,) = [each for each in found["lines"] if each["what"] == "distributions"]
    assert line["do"].startswith("pip uninstall drivetwin drivetwin-worker, then pip install ")
    call(*pip, "uninstall", "--quiet", "--yes", "drivetwin", "drivetwin-worker")
    call(*install, str(next(dist.glob("drivetwin-*.whl"))))
    found = json.loads(call(*doctor, folder=tmp_path, code=None, PYTHONPATH=""))
    subjects = {each["what"] for each in found["lines"]}
    assert "Python" in subjects
    assert "distributions" not in subjects


def test_the_list_of_components_is_that_of_the_environment(dist, tmp_path):
    wheel = next(dist.glob("drivetwin-*.whl"))
    environment(dist, wheel.name, tmp_path / "env")
    site = next((tmp_path / "env" / "lib").glob("python*/site-packages"))
    installed = {path.name.split("-")[0].lower() for path in site.glob("*.dist-info")}
    bom = json.loads(next(dist.glob("*.cdx.json")).read_text())
    assert bom["bomFormat"] == "CycloneDX"
    root = bom["metadata"]["component"]
    named = {each["name"].lower().replace("-", "_") for each in bom["components"]}
    assert named | {"drivetwin"} == installed
    assert root["name"] == "drivetwin"
    assert f"drivetwin-{root['version']}-" in wheel.name
    assert all(each["version"] and each["purl"] for each in bom["components"])
    direct = next(d for d in bom["dependencies"] if d["ref"] == root["bom-ref"])["dependsOn"]
    assert len(direct) > 15
