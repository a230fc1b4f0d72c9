"""What ends a worker or its rig: memory, the walltime, a conductor that was replaced."""

import os
import signal
import subprocess

import pytest
from processes import committed, outcomes, wait_for
from test_bad_input import campaign_file
from test_conductor_restart import committed_per_case, serve
from waiting import PATIENCE_S

from conductor.records.fingerprint import fingerprint

HUNGRY = """\
import time
from devkit.stack import Stack

class Hungry(Stack):
    def reset(self, slot, episode):
        self.hoard = b"x" * 3_000_000_000
        time.sleep(60)

    def step(self, observation):
        raise AssertionError("it was to be ended before")
"""


def test_a_rig_that_needs_too_much_memory_is_ended(marked, tmp_path, monkeypatch):
    (tmp_path / "hungry.py").write_text(HUNGRY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    path = campaign_file(tmp_path, autonomy={"stack": "hungry:Hungry"}, attempts_max=1)
    out = tmp_path / "out"
    done = marked.run(
        *("conductor", "run", str(path), "--out", str(out), "--workers", "1", "--memory-gb", "2")
    )
    assert done.returncode == 3, done.stderr
    (row,) = outcomes(out).values()
    assert row["outcome"] == "unresolved"
    assert "out_of_memory: the rig uses " in row["reasons"][0]
    assert "(simulator 0." in row["reasons"][0]
    assert "allowed are 2 " in row["reasons"][0]


def test_a_campaign_that_no_worker_may_run(marked, tmp_path):
    path = campaign_file(tmp_path, requires={"tags": ["a100"]})
    done = marked.run("conductor", "run", str(path), "--out", str(tmp_path / "c"), "--workers", "1")
    assert done.returncode == 2
    assert "has not the tag a100" in done.stderr


def test_a_worker_leaves_before_its_walltime(marked, quiet, tmp_path):
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    conductor = serve(marked, state)
    assert marked.run("conductor", "submit", "chaos-16", "--state", str(state)).returncode == 0
    # Fifteen seconds are kept for leaving and ten for the first case, of unknown length; that it
    # leaves by then is a matter of decisions, whose limits the tests of its core hold.
    first = marked.start("twin", "worker", "--state", str(state), "--walltime-s", "28")
    _, said = first.communicate()
    assert first.returncode == 0, said
    assert "the walltime ends" in said
    second = marked.start("twin", "worker", "--state", str(state), "--slots", "2", "--until-done")
    second.communicate()
    conductor.terminate()
    conductor.wait()
    rows = outcomes(campaign)
    assert fingerprint(campaign).sha256 == quiet["fingerprint"]
    assert all(row["charges"] == [] for row in rows.values())


def _can_rename_hosts():
    try:
        return not subprocess.run(["unshare", "--uts", "true"], capture_output=True).returncode
    except OSError:
        return False


@pytest.mark.skipif(not _can_rename_hosts(), reason="no rights for a UTS namespace")
def test_the_conductor_of_a_restarted_job_replaces_a_frozen_one(
    marked, quiet, tmp_path, monkeypatch
):
    """The node of the first one seemed dead; it wakes up, and finds that it has been replaced."""
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    ghost = serve(marked, state)
    assert marked.run("conductor", "submit", "chaos-16", "--state", str(state)).returncode == 0
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "2")
    wait_for(lambda: committed(campaign) >= 3, "three cases")
    ghost.send_signal(signal.SIGSTOP)

    monkeypatch.setenv("SLURM_RESTART_COUNT", "1")
    before = (state / "conductor.json").read_bytes()
    rename = 'hostname restarted; exec "$0" "$@"'
    successor = marked.start(
        *("conductor", "serve", "--state", str(state)),
        prefix=("unshare", "--uts", "sh", "-c", rename),
    )
    wait_for(lambda: (state / "conductor.json").read_bytes() != before, "the successor")
    announced = (state / "conductor.json").read_bytes()
    assert b'"host":"restarted"' in announced
    # Its worker was told nothing and is killed, as everything on a dead node.
    os.kill(worker.pid, signal.SIGKILL)
    worker.wait()
    ghost.send_signal(signal.SIGCONT)
    _, said = ghost.communicate()
    assert ghost.returncode == 3, said
    assert "taken over by the conductor" in said
    assert (state / "conductor.json").read_bytes() == announced, "the ghost left it alone"

    other = marked.start("twin", "worker", "--state", str(state), "--slots", "2", "--until-done")
    _, said = other.communicate()
    assert other.returncode == 0, said
    successor.terminate()
    successor.wait()
    assert fingerprint(campaign).sha256 == quiet["fingerprint"]
    assert set(committed_per_case(state).values()) == {1}
    assert len(committed_per_case(state)) == 16


def test_a_worker_whose_conductor_has_gone_leaves(marked, tmp_path):
    """It waits until its walltime unless it is told otherwise; its processor is not its own."""
    state = tmp_path / "state"
    conductor = serve(marked, state)
    words = ("twin", "worker", "--state", str(state), "--away-s", "0.5")
    ends = {}
    for code, more in ((3, ()), (75, ("--started-again",))):
        log = tmp_path / f"{code}.log"
        with log.open("w") as file:
            ends[code] = (marked.start(*words, *more, log=file), log)
    wait_for(lambda: all("slot(s) on" in log.read_text() for _, log in ends.values()), "workers")
    conductor.kill()
    conductor.wait()
    for code, (worker, log) in ends.items():
        assert worker.wait(PATIENCE_S) == code, log.read_text()
        last = log.read_text().splitlines()[-1]
        assert "no conductor has answered for " in last
        assert ("whoever started this may start it again" in last) is (code == 75)
