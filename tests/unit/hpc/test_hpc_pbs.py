"""PBS job scripts: their text, and that the linter agrees. UPDATE_GOLDEN=1 writes them anew."""

import os
import subprocess
from dataclasses import replace

import pytest
from test_hpc_slurm import GOLDEN, REQUESTS

from hpc.pbs.job_script import render
from hpc.pbs.lint import lint

PBS = {
    "two_cpu_workers": REQUESTS["two_cpu_workers"],
    "gpus_with_everything": replace(
        REQUESTS["gpus_with_everything"],
        gpus=7,
        account="robots",
        constraint="model=milan",
        modules=("cuda/12.4", "python/3.11"),
        scratch="$TMPDIR",
        interface="ib0",
        address="",
        directives=("-W group_list=robots", "-l place=scatter:excl"),
    ),
    "stacks_elsewhere": replace(REQUESTS["two_cpu_workers"], nodes=2, remote_stacks=True),
    "hostile": REQUESTS["hostile"],
}


@pytest.mark.parametrize("name", ["two_cpu_workers", "gpus_with_everything", "stacks_elsewhere"])
def test_golden(name):
    path = GOLDEN / f"{name}.pbs"
    text = render(PBS[name])
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(text)
    assert text == path.read_text()


@pytest.mark.parametrize("name", PBS)
def test_bash_and_the_linter_can_read_it(name):
    text = render(PBS[name])
    checked = subprocess.run(
        ["bash", "-n"], input=text, text=True, capture_output=True, check=False
    )
    assert (checked.returncode, checked.stderr) == (0, "")
    assert lint(text) == []


@pytest.mark.parametrize(
    ("changes", "select", "place"),
    [
        ({}, "2:ncpus=1:mpiprocs=1", "free"),
        ({"workers": 0, "gpus": 8}, "8:ncpus=4:ngpus=1:mpiprocs=1", "free"),
        (
            {"workers": 0, "gpus": 8, "nodes": 2},
            "2:ncpus=16:ngpus=4:mpiprocs=4",
            "scatter",
        ),
        (
            {"workers": 0, "gpus": 7, "nodes": 2},
            "1:ncpus=12:ngpus=3:mpiprocs=3+1:ncpus=16:ngpus=4:mpiprocs=4",
            "scatter",
        ),
        ({"constraint": "model=milan"}, "2:ncpus=1:mpiprocs=1:model=milan", "free"),
    ],
)
def test_chunks(changes, select, place):
    lines = render(replace(PBS["two_cpu_workers"], **changes)).splitlines()
    assert f"#PBS -l select={select}" in lines
    assert f"#PBS -l place={place}" in lines


def test_only_directives_before_the_first_command():
    lines = render(PBS["two_cpu_workers"]).splitlines()
    first_command = next(i for i, line in enumerate(lines) if line and line[0] != "#")
    assert max(i for i, line in enumerate(lines) if line.startswith("#PBS")) < first_command
