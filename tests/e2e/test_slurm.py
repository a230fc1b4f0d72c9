"""From ``hpc submit`` to the verdict on a real Slurm: a private cluster."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import slurm_cluster
import yaml
from changed_campaigns import changed, from_nearby
from container_images import missing, python_folders, shell_image
from kernel_folders import LEFT_OUT, all_but_one, compiled_before, compiled_in, of_this_processor
from processes import MARK, PATIENCE_S, committed, outcomes
from slurm_job import Job, hpc, wrapped_commands

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(slurm_cluster.missing()), reason=slurm_cluster.missing()),
]
SKEWED = """
[ "$SLURM_PROCID" != 1 ] || export PYTHONPATH="$(dirname "$0")/ahead${PYTHONPATH:+:$PYTHONPATH}"
"""
"""Worker 1, its simulator and its stack believe that it is five minutes later."""
AHEAD = """
import time
true_clock = time.time
time.time = lambda: true_clock() + 300.0
"""
ON_THE_CPU = """
echo "$SLURMD_NODENAME $CUDA_VISIBLE_DEVICES ${@: -1}" > "$3/seen-$SLURM_PROCID"
exec "$real" "${@/cuda:0/cpu}"
"""
"""There is no GPU behind the devices of this cluster: say what was given, run on the CPU."""


def render(folder, campaign, *options):
    """``hpc render``; the script's path."""
    done = subprocess.run(
        [sys.executable, "-m", "hpc", "render", campaign, "--time", "00:30", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    script = folder / "job.sh"
    script.write_text(done.stdout)
    return script


@pytest.mark.parametrize(
    "options",
    [
        ["--workers", "20", "--nodes", "3", "--restarts-max", "0"],
        ["--gpus", "6", "--slots", "64", "--partition", "main", "--account", "proj@x"],
        ["--gpus", "2", "--nodes", "2", "--cpus-per-worker", "8", "--signal-lead", "300"],
        ["--gpus", "1", "--nodes", "1", "--out", '/tmp/it\'s $(a) "folder"'],
        ["--workers", "2", "--array"],
    ],
    ids=" ".join,
)
def test_sbatch_accepts(cluster, tmp_path, options):
    script = render(tmp_path, "aeb-demo", *options)
    done = cluster.call("sbatch", "--test-only", str(script))
    assert "to start at" in done.stderr


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--workers", "1", "--partition", "fast"], 2, "invalid partition"),
        (["--gpus", "7"], 2, "node configuration is not available"),
        (
            ["--workers", "1", "--time", "30:00"],
            2,
            "longer than the partition allows (main up to 1-00:00:00)",
        ),
        (["--workers", "1", "--time", "00:03"], 2, "give --time 00:04 or more"),
        (["--workers", "1", "--out", "/proc/run"], 3, "/proc/run"),
        (["--workers", "1", "--out", "/sys/run"], 2, "/sys/run"),
        (["--workers", "1", "--site", "none.yaml"], 2, "none.yaml: No such file"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_nothing_half_submitted(cluster, tmp_path, options, code, said):
    time = [] if "--time" in options else ["--time", "00:30"]
    done = hpc(cluster, "submit", "aeb-demo", *time, *options, folder=tmp_path)
    assert done.returncode == code, done.stderr
    assert said.lower() in done.stderr.lower()
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == [], "something is left"
    assert cluster.call("squeue", "--noheader").stdout == ""


def test_nothing_is_submitted_from_a_full_disk(cluster, small_disk):
    (small_disk / "ballast").write_bytes(bytes(1 << 20))
    done = hpc(
        cluster, *["submit", "aeb-demo", "--workers", "1", "--time", "00:30"], folder=small_disk
    )
    assert done.returncode == 3, done.stderr
    assert "No space left on device" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in small_disk.iterdir()] == ["ballast"]
    assert cluster.call("squeue", "--noheader").stdout == ""


def test_doctor(cluster, tmp_path):
    done = hpc(cluster, "doctor", "--output", "json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["can_submit"]
    (partition,) = found["facts"]["partitions"]
    assert partition["name"] == "main*"
    assert "gpu:a100:2" in partition["gpus"]
    assert "gpu:v100:4" in partition["gpus"]
    assert list(tmp_path.iterdir()) == []


def test_shell(cluster, tmp_path):
    """A command inside an interactive allocation, with our commands on its path."""
    where = ["--workers", "2", "--nodes", "2", "--time", "00:05"]
    asked = ["bash", "-c", "echo $SLURM_JOB_NUM_NODES $(command -v conductor)"]
    done = hpc(cluster, "shell", *where, "--", *asked, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["2", str(Path(sys.executable).parent / "conductor")]


def test_a_worker_on_each_of_six_gpus(marked, cluster, tmp_path):
    """Two nodes of unequal size, cases that are no work: from submission to the verdict."""
    path = tmp_path / "idle.yaml"
    data = {"campaign": "idle", "simulator": "noop", "matrix": {"repeat": list(range(40))}}
    path.write_text(yaml.safe_dump(data))
    commands = str(wrapped_commands(tmp_path, ON_THE_CPU))
    job = Job(marked, cluster, tmp_path, str(path), "--gpus", "6", "--bin", commands)
    found = job.end()
    assert found["ExitCode"] == "0:0", job.text
    seen = sorted(path.read_text().strip() for path in job.out.glob("seen-*"))
    given = [("n2", 0), ("n2", 1), ("n3", 0), ("n3", 1), ("n3", 2), ("n3", 3)]
    assert seen == [f"{node} {gpu} cuda:0" for node, gpu in given]
    assert {row["outcome"] for row in outcomes(job.out).values()} == {"verdict"}
    assert len(outcomes(job.out)) == 40
    assert "exit code 0 (all passed)" in job.hpc("status")


def test_real_networks_on_two_nodes(marked, cluster, local, tmp_path):
    """One worker on each: the verdict is the exit code, the values are the same."""
    path = changed(tmp_path, "aeb-demo", from_nearby)
    job = Job(marked, cluster, tmp_path, path, "--workers", "2", "--nodes", "2")
    found = job.end()
    assert found["ExitCode"] == f"{local['code']}:0", job.text
    assert (found["Restarts"], found["NumNodes"]) == ("0", "2")
    done = marked.run("conductor", "fingerprint", str(job.out))
    assert done.stdout.strip() == local["fingerprint"]
    assert (job.out / "report.html").exists()
    assert f"{local['passed']} of 8 passed" in job.text
    assert {line[:2] for line in job.text.splitlines() if "slot(s) on cpu" in line} == {"0:", "1:"}
    assert not (job.out / "conductor.json").exists()


def test_told_to_stop(marked, cluster, quiet, tmp_path):
    """As before the end of the wall time: drained, queued again, finished by the second start.

    The clock of one worker is five minutes ahead all the while.
    """
    commands = wrapped_commands(tmp_path, SKEWED)
    (commands / "ahead").mkdir()
    (commands / "ahead" / "sitecustomize.py").write_text(AHEAD)
    options = ("--workers", "2", "--bin", str(commands))
    job = Job(marked, cluster, tmp_path, "chaos-16", *options)
    job.wait(lambda: committed(job.out) >= 2, "two cases")
    job.hpc("requeue")
    job.wait(lambda: cluster.job(job.id)["Restarts"] == "1", "the second start")
    again = ("submit", "chaos-16", "--workers", "1", "--time", "00:30", "--out", str(job.out))
    refused = hpc(cluster, *again, folder=tmp_path)
    assert f"job {job.id} is " in refused.stderr
    assert "and works here" in refused.stderr
    assert refused.returncode == 2
    rows = outcomes(job.out)
    done = {name for name, row in rows.items() if row["outcome"]}
    assert 2 <= len(done) < 16
    before = {name: kpi_ns(job.out, rows[name]) for name in done}
    found = job.end()
    assert (found["ExitCode"], found["Restarts"]) == ("1:0", "1"), job.text
    assert job.text.count("unfinished, queued again") == 1
    rows = outcomes(job.out)
    assert len(rows) == 16
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert all(row["charges"] == [] for row in rows.values())
    assert before == {name: kpi_ns(job.out, rows[name]) for name in done}, "done twice"
    assert quiet["fingerprint"] in job.text


def kpi_ns(out: Path, row) -> int:
    """When the committed attempt's values were written [ns]."""
    return (out / row["attempt_dir"] / "kpi.parquet").stat().st_mtime_ns


def test_cancelled(marked, cluster, quiet, tmp_path):
    """Whoever cancels a job does not want it queued again; submitted again, it goes on."""
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "2")
    job.wait(lambda: committed(job.out) >= 1, "a case")
    job.hpc("cancel")
    found = job.end()
    assert (found["JobState"], found["Restarts"]) == ("CANCELLED", "0")
    assert "queued again" not in job.text
    assert all(row["charges"] == [] for row in outcomes(job.out).values())
    resumed = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "2")
    assert resumed.end()["ExitCode"] == "1:0", resumed.text
    assert "going on, " in resumed.text
    assert quiet["fingerprint"] in resumed.text


def test_a_second_job_joins(marked, cluster, quiet, tmp_path):
    """As docs/cluster.md says it; it was there first and waited for the campaign."""
    out = tmp_path / "a folder"
    worker = f"{sys.executable} -m twin worker --state '{out}' --wait 120 --until-done"
    cluster.call(
        *("sbatch", "--ntasks=1", "--time=00:30:00", "--signal=TERM@60"),
        *("--wrap", f"srun --no-kill {worker}"),
        folder=tmp_path,
        environment={MARK: marked.mark},
    )
    job = Job(marked, cluster, tmp_path, "chaos-16", "--workers", "1")
    assert job.end()["ExitCode"] == "1:0", job.text
    assert len({row["worker"] for row in outcomes(job.out).values()}) == 2
    assert quiet["fingerprint"] in job.text


@pytest.mark.parametrize("runtime", ["charliecloud", "apptainer"])
def test_a_job_inside_a_container(marked, quiet, cluster, tmp_path, runtime):
    """Conductor, workers and stacks of one job inside an image; see test_containers.py for it."""
    if reason := missing({"charliecloud": "ch-run"}.get(runtime, runtime)):
        pytest.skip(reason)
    image = shell_image(tmp_path / "image")
    place = all_but_one(tmp_path / "a folder" / "kernels" / of_this_processor())
    binds = (*python_folders(), Path(__file__).parents[2], compiled_before())
    job = Job(
        *(marked, cluster, tmp_path, "chaos-16", "--workers", "3", "--container", str(image)),
        *("--container-runtime", runtime, "--bin", str(Path(sys.executable).parent)),
        *(word for path in binds for word in ("--container-bind", str(path))),
        APPTAINER_USERNS="1",  # what an ordinary user gets anyway
    )
    assert job.end()["ExitCode"] == "1:0", job.text
    done = marked.run("conductor", "fingerprint", str(job.out))
    assert done.stdout.strip() == quiet["fingerprint"], done.stderr + job.text
    (compiled,) = compiled_in(place)
    assert compiled.startswith(LEFT_OUT), "kernels are kept outside the image"


def test_a_job_from_python(cluster, tmp_path):
    """What `hpc submit` does, asked for by a program, which then reads the run."""
    (tmp_path / "small.yaml").write_text(
        "campaign: small\nsimulator: noop\nmatrix: {repeat: [0, 1, 2]}\n"
    )
    submit = (
        "import drivetwin\n"
        "job = drivetwin.submit('small.yaml', time='00:30', workers=1, scheduler='slurm')\n"
        "print(job.job, job.out)"
    )
    done = cluster.call(sys.executable, "-c", submit, folder=tmp_path)
    number, out = done.stdout.split()
    assert out == str(tmp_path / "runs" / "small")
    assert cluster.wait(lambda: cluster.ended(number), "the end of the job")
    code = f"import drivetwin; print(drivetwin.open({out!r}).summary())"
    done = cluster.call(sys.executable, "-c", code, folder=tmp_path)
    assert done.stdout.strip() == "3 of 3 passed (3 pass)"
