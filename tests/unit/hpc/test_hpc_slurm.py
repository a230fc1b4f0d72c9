"""The text of job scripts. Goldens are written anew by ``UPDATE_GOLDEN=1 pytest`` on this file."""

import os
import subprocess
from pathlib import Path

import pytest

from hpc.request import JobRequest
from hpc.script import job_name
from hpc.slurm.job_script import render

GOLDEN = Path(__file__).parent
HOSTILE = '/data/a b/it\'s "quoted" $(touch pwned) `id` ; & | * \\ é'
PLACE = {"folder": "/work", "bin_folder": "/opt/drivetwin/bin", "walltime_min": 60}
REQUESTS = {
    "two_cpu_workers": JobRequest(
        campaign="aeb-demo", out="/project/runs/aeb-demo", workers=2, **PLACE
    ),
    "gpus_with_everything": JobRequest(
        campaign="/home/me/night campaign.yaml",
        out="/scratch/me/night's",
        gpus=8,
        nodes=2,
        partition="gpu",
        account="proj@a100",
        slots=64,
        cpus_per_worker=8,
        signal_lead_s=120,
        restarts_max=3,
        address="10.1.2.3",
        home="/home/me/my config",
        **PLACE,
    ),
    "one_node": JobRequest(campaign="aeb-256", out="/project/runs/x", gpus=4, nodes=1, **PLACE),
    "joining": JobRequest(
        campaign="aeb-demo",
        out="/home/me/dt/aeb-demo-1a/north-3",
        gpus=4,
        join="/home/me/dt/aeb-demo-1a/north-3/worker.key",
        connect="tls/login:7447",
        site="north",
        allocation="north-3",
        **PLACE,
    ),
    "hostile": JobRequest(
        campaign=f"{HOSTILE}.yaml",
        out=HOSTILE,
        folder=HOSTILE,
        bin_folder=HOSTILE,
        walltime_min=3,
        workers=1,
        home=HOSTILE,
        join=f"{HOSTILE}/worker.key",
        connect="tls/login:7447",
    ),
}


@pytest.mark.parametrize("name", ["two_cpu_workers", "gpus_with_everything", "one_node", "joining"])
def test_golden(name):
    path = GOLDEN / f"{name}.sh"
    text = render(REQUESTS[name])
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(text)
    assert text == path.read_text()


@pytest.mark.parametrize("name", REQUESTS)
def test_bash_can_read_it(name):
    checked = subprocess.run(
        ["bash", "-n"], input=render(REQUESTS[name]), text=True, capture_output=True, check=False
    )
    assert (checked.returncode, checked.stderr) == (0, "")


@pytest.mark.parametrize("name", REQUESTS)
def test_shape(name):
    text = render(REQUESTS[name])
    lines = text.splitlines()
    assert lines[0] == "#!/bin/bash"
    assert text.endswith("\n")
    assert not text.endswith("\n\n")
    first_command = next(i for i, line in enumerate(lines) if line and line[0] != "#")
    asked = [i for i, line in enumerate(lines) if line.startswith("#SBATCH")]
    assert max(asked) < first_command, "sbatch stops reading at the first command"
    assert all(line == line.rstrip() for line in lines)


def test_hostile_names_are_quoted(tmp_path):
    """bash reads back exactly what was asked for, and runs nothing of it."""
    text = render(REQUESTS["hostile"])
    names = text[text.index("campaign=") : text.index("restarts_max=")]
    done = subprocess.run(
        ["bash", "-c", names + 'printf "%s\\0" "$campaign" "$out" "$bin"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split("\0")[:-1] == [f"{HOSTILE}.yaml", HOSTILE, HOSTILE]
    assert list(tmp_path.iterdir()) == []
    header = [line for line in text.splitlines() if line.startswith("#")]
    assert not any("pwned)" in line or "`id`" in line for line in header)


@pytest.mark.parametrize(
    ("campaign", "name"),
    [
        ("aeb-demo", "aeb-demo"),
        ("/a/b/night.yaml", "night"),
        ("/a/b c/über $(x).yml", "ber-x"),
        ("/a/---.yaml", "campaign"),
        ("x" * 100, "x" * 64),
    ],
)
def test_job_name(campaign, name):
    assert job_name(campaign) == name
