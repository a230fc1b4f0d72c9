"""``hpc render`` as a user meets it."""

import subprocess
import sys

import pytest
from waiting import PATIENCE_S


def hpc(*arguments, folder):
    """Run the command in ``folder``."""
    return subprocess.run(
        [sys.executable, "-m", "hpc", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_render(tmp_path):
    done = hpc("render", "aeb-demo", "--workers", "2", "--time", "00:10", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("#!/bin/bash\n")
    assert f"out={tmp_path}/runs/aeb-demo\n" in done.stdout
    assert f"folder={tmp_path}\n" in done.stdout
    assert "#SBATCH --time=00:10:00\n" in done.stdout


def test_a_file_becomes_absolute(tmp_path):
    shipped = "matrix: {weather: [clear]}\ncampaign: mine\n"
    (tmp_path / "my campaign.yaml").write_text(shipped)
    done = hpc("render", "my campaign.yaml", "--gpus", "1", "--time", "1:00", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"campaign='{tmp_path}/my campaign.yaml'\n" in done.stdout
    assert f"out={tmp_path}/runs/my-campaign\n" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["aeb-dem", "--workers", "1", "--time", "1:00"], "aeb-demo"),
        (["aeb-demo", "--workers", "1", "--time", "60"], "HH:MM"),
        (["aeb-demo", "--time", "1:00"], "--gpus N"),
        (["aeb-demo", "--workers", "1", "--time", "0:01"], "--time 00:01"),
        (["aeb-demo", "--workers", "1", "--time", "1:00", "--out", "a\nb"], "line break"),
    ],
)
def test_one_line_errors(tmp_path, arguments, said):
    done = hpc("render", *arguments, folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_every_mistake_of_a_file_is_told(tmp_path):
    (tmp_path / "bad.yaml").write_text("campaign: mine\nsped: 1\nseed: x\n")
    done = hpc("render", "bad.yaml", "--workers", "1", "--time", "1:00", folder=tmp_path)
    assert done.returncode == 2
    assert "sped" in done.stderr
    assert "seed" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["render", "--help"], ["--version"]])
def test_help(tmp_path, arguments):
    done = hpc(*arguments, folder=tmp_path)
    assert done.returncode == 0
    assert done.stdout


def test_an_earlier_run_is_one_that_the_nodes_see(tmp_path):
    words = ("render", "aeb-demo", "--workers", "2", "--time", "00:10", "--history")
    done = hpc(*words, "runs/old", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(
        "hpc: --history runs/old: no outcomes.json there; give the folder"
    )
    assert len(done.stderr.splitlines()) == 1
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "outcomes.json").write_text("{}")
    done = hpc(*words, "old", "--container", "/images/x.sif", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"\nhistory={tmp_path}/old #" in done.stdout
    assert '--state "$out" \\\n  --history "$history" &' in done.stdout
    assert "--history" not in hpc(*words[:-1], folder=tmp_path).stdout
    done = hpc(*words, "old", "--array", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("hpc: --history: an array has no conductor")
