"""Real processes under random SIGKILL, SIGSTOP and SIGCONT: nothing lost, nothing twice.

`STORMS=100 pytest tests/e2e/test_storms.py` (`make faults`) runs a hundred of them.
"""

import os
import signal

import pytest
from processes import committed, outcomes, wait_for
from storm import Storm, read_ledger

from conductor.fingerprint import fingerprint

STORMS = int(os.environ.get("STORMS", "5"))


def check(storm, quiet):
    """Sixteen cases, one commit each, the quiet run's values, and no attempt that disagrees."""
    ledger = read_ledger(storm.state)
    rows = outcomes(storm.campaign)
    assert len(rows) == 16
    assert all(row["outcome"] == "verdict" for row in rows.values())
    assert dict(ledger.commits) == dict.fromkeys(rows, 1)
    assert ledger.disagreeing == []
    assert fingerprint(storm.campaign).sha256 == quiet["fingerprint"]
    return ledger


@pytest.mark.parametrize("seed", range(STORMS))
def test_storm(marked, quiet, tmp_path, seed):
    storm = Storm(marked, tmp_path, seed)
    storm.run()
    print(f"seed {seed}: {dict(storm.faults)}")
    assert sum(storm.faults.values()) >= 3, "a storm that hurts nobody proves nothing"
    check(storm, quiet)


def test_a_zombie_is_fenced(marked, quiet, tmp_path):
    """A worker is frozen past its time to live; its rig goes on and finishes what it had.

    A successor runs the same cases and commits them; then the zombie wakes up and delivers.
    """
    storm = Storm(marked, tmp_path, seed=0, deadline_s=60.0)
    storm.start()
    storm.submit()
    zombie = storm.worker()
    wait_for(lambda: committed(storm.campaign) >= 2, "two cases")
    zombie.send_signal(signal.SIGSTOP)
    storm.worker()
    wait_for(storm.complete, "the successor's end of the campaign")
    zombie.send_signal(signal.SIGCONT)
    storm.finish()
    ledger = check(storm, quiet)
    assert {ledger.pids[fact.worker] for fact in ledger.late} == {zombie.pid}


def test_a_zombie_is_fenced_while_its_successor_runs_long(marked, quiet, tmp_path):
    """The zombie delivers a case that its successor holds and has not ended: its token is dead.

    The successor's simulator is frozen, so the case stays leased as long as the test wants.
    """
    storm = Storm(marked, tmp_path, seed=0, deadline_s=60.0)
    storm.start()
    storm.submit()
    zombie = storm.worker()
    wait_for(lambda: committed(storm.campaign) >= 2, "two cases")
    zombie.send_signal(signal.SIGSTOP)
    wait_for(lambda: storm.row()["leased"] == 0, "the end of the zombie's leases")
    old = {process.pid for process in marked.processes("sim")}
    storm.worker()
    simulator = wait_for(
        lambda: next((p for p in marked.processes("sim") if p.pid not in old), None),
        "the successor's simulator",
    )
    simulator.send_signal(signal.SIGSTOP)
    assert storm.row()["leased"] >= 1
    assert storm.status()["counters"]["fenced"] == 0
    zombie.send_signal(signal.SIGCONT)
    wait_for(lambda: storm.status()["counters"]["fenced"], "the zombie's delivery")
    simulator.send_signal(signal.SIGCONT)
    wait_for(storm.complete, "the end of the campaign")
    storm.finish()
    ledger = check(storm, quiet)
    assert zombie.pid in {ledger.pids[fact.worker] for fact in ledger.late}


def test_a_frozen_tree_is_succeeded(marked, quiet, tmp_path):
    """Worker, simulator and stack are frozen together, and wake up after the end."""
    storm = Storm(marked, tmp_path, seed=0, deadline_s=60.0)
    storm.start()
    storm.submit()
    worker = storm.worker()
    wait_for(lambda: committed(storm.campaign) >= 2, "two cases")
    tree = [worker, *worker.children(recursive=True)]
    for process in tree:
        process.send_signal(signal.SIGSTOP)
    storm.worker()
    wait_for(storm.complete, "the successor's end of the campaign")
    for process in tree:
        process.send_signal(signal.SIGCONT)
    storm.finish()
    check(storm, quiet)
