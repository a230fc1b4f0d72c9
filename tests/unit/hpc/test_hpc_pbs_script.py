"""Rendered PBS scripts run by bash, with stand-ins for PBS's commands and for ours."""

import signal

import pytest
from test_hpc_script_logic import STUBS, Job
from waiting import PATIENCE_S, wait_for

from hpc.pbs.job_script import render
from hpc.request import JobRequest

PBS_STUBS = {
    "bin/conductor": STUBS["bin/conductor"],
    "bin/twin": """
        echo "${NODE-here} ${CUDA_VISIBLE_DEVICES-none}" >> "$T/seen"
        printf '%s\\n' "$@" > "$T/worker.args"; [ ! "$STAY" ] || exec sleep 60
    """,
    "bin/devkit": 'echo "$@" >> "$T/devkit.args"; exec sleep 60',
    "pbs/qsub": 'echo "$@" >> "$T/qsub.args"; [ ! "$NO_QSUB" ] || exit 1; echo 12.head',
    "pbs/ssh": """
        echo "$@" >> "$T/ssh.args"; shift 2
        case $1 in head) echo 13.head ;; *) export NODE="$1"; shift; exec "$@" ;; esac
    """,
}


class PbsJob(Job):
    """The script of PBS in a folder of its own."""

    stubs = PBS_STUBS
    tools = "pbs"

    def render(self, request):
        return render(JobRequest(**request))

    def start(self, **environment):
        own = {"PBS_JOBID": "7.head", "PBS_O_WORKDIR": str(self.folder), "PBS_O_HOST": "head"}
        return super().start(**own, **environment)

    def nodes(self, *names):
        """A node file."""
        (self.folder / "nodes").write_text("".join(f"{name}\n" for name in names))
        return {"PBS_NODEFILE": str(self.folder / "nodes")}

    def seen(self):
        return sorted((self.folder / "seen").read_text().splitlines())


@pytest.mark.parametrize("verdict", ["0", "1", "3"])
def test_the_verdict_is_the_exit_code(tmp_path, verdict):
    job = PbsJob(tmp_path)
    assert job.run(VERDICT=verdict)[0] == int(verdict)
    assert job.said("qsub") == ""
    assert job.seen() == ["here none", "here none"]
    assert (tmp_path / "o ut" / "job.sh").read_text() == (tmp_path / "job.sh").read_text()


@pytest.mark.parametrize(
    ("environment", "code", "submitted"),
    [
        ({"VERDICT": "75"}, 75, "-v DRIVETWIN_RESTARTS=1 "),
        ({"VERDICT": "75", "DRIVETWIN_RESTARTS": "19"}, 75, "-v DRIVETWIN_RESTARTS=20 "),
        ({"VERDICT": "75", "DRIVETWIN_RESTARTS": "20"}, 75, ""),
        ({"KILLED": "1"}, 3, ""),
        ({"VERDICT": "0", "STAY": "1"}, 0, ""),
    ],
)
def test_ends(tmp_path, environment, code, submitted):
    job = PbsJob(tmp_path)
    assert job.run(**environment)[0] == code
    assert submitted in job.said("qsub")
    assert bool(job.said("qsub")) == bool(submitted)
    if submitted:
        assert job.said("qsub").startswith("-W depend=afterany:7.head ")
        assert job.said("qsub").endswith(" job.sh\n")
        assert (tmp_path / "o ut" / "job.id").read_text() == "pbs 12.head\n"


def test_where_nodes_may_not_submit_the_login_node_is_asked(tmp_path):
    job = PbsJob(tmp_path)
    code, err = job.run(VERDICT="75", NO_QSUB="1")
    assert (code, "queued again as 13.head" in err) == (75, True)
    assert "head cd" in job.said("ssh")


@pytest.mark.parametrize(("number", "submitted"), [(signal.SIGUSR2, True), (signal.SIGTERM, False)])
def test_the_timers_signal_submits_again_and_qdel_does_not(tmp_path, number, submitted):
    job = PbsJob(tmp_path)
    (tmp_path / "hold").touch()
    with job.start(STAY="1") as child:
        wait_for(lambda: job.said("worker"), "the worker")
        child.send_signal(number)
        child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 75
    assert bool(job.said("qsub")) == submitted


def test_each_worker_of_each_node_has_its_own_gpu(tmp_path):
    job = PbsJob(tmp_path, workers=0, gpus=3, address="192.0.2.1")
    assert job.run(**job.nodes("far", "far", "far"))[0] == 0
    assert job.seen() == ["far 0", "far 1", "far 2"]
    assert "BatchMode=yes far /bin/bash -s" in job.said("ssh")


def test_the_gpus_that_pbs_names_are_used(tmp_path):
    job = PbsJob(tmp_path, workers=0, gpus=2)
    assert job.run(CUDA_VISIBLE_DEVICES="GPU-a,GPU-b")[0] == 0
    assert job.seen() == ["here GPU-a", "here GPU-b"]


def test_stacks_run_on_the_last_tasks(tmp_path):
    job = PbsJob(tmp_path, workers=1, remote_stacks=True, remote_commands=True)
    (tmp_path / "hold").touch()
    with job.start(STAY="1") as child:  # a worker that ends takes its stack along
        wait_for(lambda: job.said("devkit"), "the stack")
        (tmp_path / "hold").unlink()
        child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 0
    assert job.said("devkit") == f"host --join {tmp_path}/o ut/rigs --commands\n"
    assert job.said("worker").splitlines()[-1] == str(tmp_path / "o ut" / "rigs")
