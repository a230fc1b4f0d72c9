"""A batch system of another distribution: its declaration and its folder are all that it takes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from foreign_distributions import install
from plugin_site import EXAMPLE, install_example
from waiting import PATIENCE_S

from schemas.kinds.batch_system import KINDS

ROOT = Path(__file__).resolve().parents[3]

DECLARATION = (EXAMPLE / "plugin_example/hut_kind.py").read_text()

HUTSUB = """#!/bin/bash
case $1 in
  --version) echo "hut 1" ;;
  --dry-run) grep -q '^#HUT ' && [ "$2" = ground ] || { echo "no floor $2" >&2; exit 1; } ;;
  --cancel) echo "$2" >> "$HUT_FOLDER/cancelled" ;;
  *) cp "$1" "$HUT_FOLDER/queued" && echo hut-7 ;;
esac
"""


class Installed:
    """The example beside ours, and the command of its batch system; nothing is in the tree."""

    def __init__(self, folder: Path, example: Path) -> None:
        self.folder = folder
        self.packages = folder / "site"
        self.example = example
        self.program("hutsub", HUTSUB)

    def file(self, name: str, text: str) -> None:
        path = self.packages / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def program(self, name: str, text: str) -> None:
        path = self.folder / "bin" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def distribution(self, name: str, *points: str) -> None:
        lines = "\n".join(("[drivetwin.schedulers]", *points))
        install(self.packages, name, "1.0", lines)

    def hpc(
        self, *words: str, path: str | None = os.environ["PATH"]
    ) -> subprocess.CompletedProcess[str]:
        own = {
            "PYTHONPATH": f"{ROOT}:{self.example}:{self.packages}",
            # Other batch systems of this machine would be found first.
            "PATH": ":".join(part for part in (str(self.folder / "bin"), path) if part),
            "HUT_FOLDER": str(self.folder),
            "XDG_CONFIG_HOME": str(self.folder),
        }
        return subprocess.run(
            [sys.executable, "-m", "hpc", *words],
            cwd=self.folder,
            env={**os.environ, **own},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )


JOB = ("aeb-demo", "--workers", "2", "--time", "00:10", "--bin", "/opt/bin")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    return install_example(tmp_path_factory.mktemp("example"))[0]


@pytest.fixture
def hut(tmp_path, example):
    return Installed(tmp_path, example)


def test_help_names_it(hut):
    shown = " ".join(hut.hpc("render", "--help").stdout.split())
    assert f"--scheduler <auto|{'|'.join(kind.name for kind in KINDS)}|hut>" in shown
    meant = ", ".join(f"{kind.constraint} ({kind.title})" for kind in KINDS)
    assert f"{meant}, a floor (Hut)" in shown
    opened = ", ".join(f"`{kind.opens}`" for kind in KINDS if kind.opens)
    assert f"({opened}, `hutsub --shell`)" in " ".join(hut.hpc("shell", "--help").stdout.split())


def test_a_script_is_rendered(hut):
    done = hut.hpc("render", *JOB, "--scheduler", "hut")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("#!/bin/bash\n#HUT aeb-demo\n")
    assert "campaign=aeb-demo\n" in done.stdout
    done = hut.hpc("render", *JOB, "--scheduler", "hut", "--array")
    assert (done.returncode, done.stderr) == (
        2,
        "hpc: --array: not in a hut; see docs/cluster.md\n",
    )


def test_a_job_is_tried_submitted_shown_and_cancelled(hut):
    (hut.folder / "site.yaml").write_text("scheduler: hut\n")
    job = (*JOB, "--site", "site.yaml")
    done = hut.hpc("submit", *job, "--partition", "attic")
    assert (done.returncode, done.stderr) == (
        2,
        "hpc: Hut refuses this job: no floor attic; see docs/cluster.md\n",
    )
    assert not (hut.folder / "runs").exists()
    done = hut.hpc("submit", *job, "--output", "json")
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    assert (told["scheduler"], told["job"]) == ("hut", "hut-7")
    assert (hut.folder / "queued").read_text().startswith("#!/bin/bash\n#HUT aeb-demo\n")
    assert (hut.folder / "runs/aeb-demo/job.id").read_text() == "hut hut-7\n"
    line = "hut job hut-7: KNOCKING, waits for: nobody opens\n"
    for place in (["runs/aeb-demo"], ["hut-7", "--scheduler", "hut"]):
        assert hut.hpc("status", *place).stdout == line
    assert hut.hpc("cancel", "runs/aeb-demo").returncode == 0
    assert (hut.folder / "cancelled").read_text() == "hut-7\n"
    done = hut.hpc("status", "7", "--scheduler", "hut")
    assert done.returncode == 2
    assert "no run folder with a job.id" in done.stderr


def test_an_interactive_allocation(hut):
    words = ("shell", "--gpus", "1", "--time", "1:00", "--bin", "/opt/bin", "--scheduler", "hut")
    done = hut.hpc(*words, "--print", "--", "nvidia-smi")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("hutsub --shell bash -c ")


def test_what_doctor_says(hut):
    facts = json.loads(hut.hpc("doctor", "--output", "json", path=None).stdout)["facts"]
    assert (facts["scheduler"], facts["version"]) == ("hut", "hut 1")
    assert facts["looked_for"] == [*(kind.submits for kind in KINDS if kind.submits), "hutsub"]
    assert [each["name"] for each in facts["partitions"]] == ["ground"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "why"),
    [
        ("cave = cave_that_is_missing:CAVE", "No module named 'cave_that_is_missing'"),
        ("cave = plugin_example.hut:Hut", "not a BatchSystemKind"),
    ],
)
def test_a_broken_distribution_is_named_and_stops_nobody_else(hut, points, why):
    hut.distribution("spelunking", points)
    done = hut.hpc("render", *JOB)
    assert (done.returncode, done.stderr) == (0, "")
    lines = json.loads(hut.hpc("doctor", "--output", "json").stdout)["lines"]
    found = next(line["found"] for line in lines if line["what"] == "plug-in")
    assert found.startswith("spelunking 1.0: entry point 'cave'")
    (hut.folder / "site.yaml").write_text("scheduler: cave\n")
    done = hut.hpc("render", *JOB, "--site", "site.yaml")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "scheduler cave: spelunking 1.0: entry point 'cave'" in done.stderr
    assert why in done.stderr


def test_a_name_that_is_taken(hut):
    hut.distribution("again", "slurm = again:SLURM")
    hut.file("again.py", DECLARATION.replace('"hut"', '"slurm"').replace("HUT =", "SLURM ="))
    assert "the name 'slurm' is taken" in hut.hpc("doctor", "--output", "json").stdout
    assert "#SBATCH" in hut.hpc("render", *JOB).stdout
