"""A conductor that is killed and started again goes on; commands by hand in three terminals."""

from collections import Counter

from processes import committed, outcomes, wait_for

from conductor.facts import Committed
from conductor.fingerprint import fingerprint
from conductor.journal import Journal
from twin.fabric.discovery import find_conductor


def serve(marked, state, *options):
    """Start ``conductor serve`` and wait until it listens."""
    child = marked.start("conductor", "serve", "--state", str(state), *options)
    wait_for(
        lambda: (state / "conductor.json").exists() and find_conductor(state).pid == child.pid,
        "the conductor",
    )
    return child


def test_serve_killed_and_restarted(marked, quiet, tmp_path):
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    first = serve(marked, state)
    submitted = marked.run("conductor", "submit", "chaos-16", "--state", str(state))
    assert submitted.returncode == 0, submitted.stderr
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "2")
    wait_for(lambda: committed(campaign) >= 4, "four cases")
    first.kill()
    first.wait()
    port = find_conductor(state).endpoint
    second = serve(marked, state)
    assert find_conductor(state).endpoint == port, "workers look for it at the old port"
    wait_for(lambda: (campaign / "outcomes.json").exists(), "the end of the campaign")
    status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    assert '"left": 0' in status.stdout
    worker.terminate()
    assert worker.wait() == 0
    second.terminate()
    assert second.wait() == 0
    rows = outcomes(campaign)
    assert len(rows) == 16
    assert all(row["outcome"] == "verdict" for row in rows.values())
    assert fingerprint(campaign).sha256 == quiet["fingerprint"]
    assert set(committed_per_case(state).values()) == {1}


def committed_per_case(state):
    """Case -> Committed facts in the journal."""
    journal = Journal(state)
    try:
        return Counter(f.result.case for f in journal.fold() if isinstance(f, Committed))
    finally:
        journal.close()


def test_a_second_conductor_on_the_folder_is_refused(marked, tmp_path):
    first = serve(marked, tmp_path / "state")
    second = marked.run("conductor", "serve", "--state", str(tmp_path / "state"))
    assert second.returncode == 2
    assert str(first.pid) in second.stderr
    assert len(second.stderr.strip().splitlines()) == 1
    first.terminate()
    first.wait()
