"""Workers that were taken for dead and wake up: what they deliver changes nothing.

Random signals to all processes, and much else, are in tests/faults.
"""

import signal

from processes import committed, outcomes, wait_for
from served_campaign import ServedCampaign, read_ledger

from conductor.records.fingerprint import fingerprint


def check(served, quiet):
    """Sixteen cases, one commit each, the quiet run's values, and no attempt that disagrees."""
    ledger = read_ledger(served.state)
    rows = outcomes(served.campaign)
    assert len(rows) == 16
    assert all(row["outcome"] == "verdict" for row in rows.values())
    assert dict(ledger.commits) == dict.fromkeys(rows, 1)
    assert ledger.disagreeing == []
    assert fingerprint(served.campaign).sha256 == quiet["fingerprint"]
    return ledger


def test_a_zombie_is_fenced(marked, quiet, tmp_path):
    """A worker is frozen past its time to live; its rig goes on and finishes what it had.

    A successor runs the same cases and commits them; then the zombie wakes up and delivers.
    """
    served = ServedCampaign(marked, tmp_path)
    served.start()
    served.submit()
    zombie = served.worker()
    wait_for(lambda: committed(served.campaign) >= 2, "two cases")
    zombie.send_signal(signal.SIGSTOP)
    served.worker()
    wait_for(served.complete, "the successor's end of the campaign")
    zombie.send_signal(signal.SIGCONT)
    served.finish()
    ledger = check(served, quiet)
    # Whether its successor once was silent for two seconds is a matter of the machine.
    assert zombie.pid in {ledger.pids[fact.worker] for fact in ledger.late}


def test_a_zombie_is_fenced_while_its_successor_runs_long(marked, quiet, tmp_path):
    """The zombie delivers a case that its successor holds and has not ended: its token is dead.

    The successor's simulator is frozen, so the case stays leased as long as the test wants.
    """
    served = ServedCampaign(marked, tmp_path)
    served.start()
    served.submit()
    zombie = served.worker()
    wait_for(lambda: committed(served.campaign) >= 2, "two cases")
    zombie.send_signal(signal.SIGSTOP)
    wait_for(lambda: served.row()["leased"] == 0, "the end of the zombie's leases")
    old = {process.pid for process in marked.processes("sim")}
    served.worker()
    simulator = wait_for(
        lambda: next((p for p in marked.processes("sim") if p.pid not in old), None),
        "the successor's simulator",
    )
    simulator.send_signal(signal.SIGSTOP)
    assert served.row()["leased"] >= 1
    assert served.status()["counters"]["fenced"] == 0
    zombie.send_signal(signal.SIGCONT)
    wait_for(lambda: served.status()["counters"]["fenced"], "the zombie's delivery")
    simulator.send_signal(signal.SIGCONT)
    wait_for(served.complete, "the end of the campaign")
    served.finish()
    ledger = check(served, quiet)
    assert zombie.pid in {ledger.pids[fact.worker] for fact in ledger.late}


def test_a_frozen_tree_is_succeeded(marked, quiet, tmp_path):
    """Worker, simulator and stack are frozen together, and wake up after the end."""
    served = ServedCampaign(marked, tmp_path)
    served.start()
    served.submit()
    worker = served.worker()
    wait_for(lambda: committed(served.campaign) >= 2, "two cases")
    tree = [worker, *worker.children(recursive=True)]
    for process in tree:
        process.send_signal(signal.SIGSTOP)
    served.worker()
    wait_for(served.complete, "the successor's end of the campaign")
    for process in tree:
        process.send_signal(signal.SIGCONT)
    served.finish()
    check(served, quiet)
