"""Local workers of several places: what each is told, and what the conductor hears of it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import psutil
from waiting import wait_for

from conductor.core.facts import WorkerJoined
from conductor.journal.store import Journal
from conductor.run.local_workers import LocalWorkers
from conductor.run.places import WorkerPlace
from schemas.wire.control import Share
from twin.base.gpu.first_use import PLACE_VARIABLE
from twin.base.worker_start import LocalWorker

SHARES = [Share(stretch, 2, 0, 1) for stretch in range(2)]

RUN = """
import sys
from conductor import cli
from conductor.run import command as run
from conductor.run.places import WorkerPlace
from schemas.wire.control import Share
run._places = lambda options, left: [WorkerPlace("cpu", (), Share(n, 2, 0, 1)) for n in range(2)]
sys.exit(cli.main())
"""


def test_shares_reach_the_conductor(tmp_path):
    campaign = tmp_path / "campaign.yaml"
    matrix = {"repeat": list(range(40))}
    campaign.write_text(json.dumps({"campaign": "c", "simulator": "noop", "matrix": matrix}))
    out = tmp_path / "out"
    command = [sys.executable, "-c", RUN, "run", str(campaign), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    journal = Journal(out)
    try:
        joined = [fact for fact in journal.fold() if isinstance(fact, WorkerJoined)]
    finally:
        journal.close()
    assert joined
    assert all(fact.share in SHARES for fact in joined)
    assert len({fact.share for fact in joined}) == len(joined)


def test_one_that_takes_the_place_of_a_dead_one_has_its_turn(tmp_path):
    def place_of(pid):
        """None: it is still a copy of this process, which has no place."""
        for each in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0"):
            if each.startswith(f"{PLACE_VARIABLE}=".encode()):
                return each.partition(b"=")[2]
        return None

    def places():
        pids = [child.process.pid for child in workers.children]
        return {pid: int(wait_for(lambda pid=pid: place_of(pid), "its place")) for pid in pids}

    workers = LocalWorkers(
        LocalWorker(), tmp_path, [WorkerPlace("cpu", (), share) for share in SHARES]
    )
    try:
        workers.start()
        before = places()
        assert sorted(before.values()) == [0, 1]
        (dead,) = (pid for pid, place in before.items() if place == 0)
        psutil.Process(dead).send_signal(signal.SIGKILL)
        wait_for(workers.look, "word of the dead one")
        workers.start()
        after = places()
        assert sorted(after.values()) == [0, 1]
        assert dead not in after
    finally:
        workers.stop()
