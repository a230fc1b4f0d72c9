"""A conductor that is killed and started again goes on; commands by hand in three terminals."""

import json
import time
from collections import Counter

from processes import committed, outcomes, wait_for

from conductor.core.facts import Committed
from conductor.journal.store import Journal
from conductor.records.fingerprint import fingerprint
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
    made = marked.run("conductor", "report", str(campaign), "--output", "json")
    assert made.returncode == 75, made.stderr
    found = json.loads(made.stdout)
    assert (found["complete"], found["running"], found["fingerprint"]) == (False, True, None)
    assert found["cases_total"] == 16
    page = (campaign / "report.html").read_text()
    assert f"Still running: {found['not_ended']} of 16 cases have not ended" in page
    port = find_conductor(state).endpoint
    second = serve(marked, state)
    assert find_conductor(state).endpoint == port, "workers look for it at the old port"
    wait_for(
        lambda: all(row["outcome"] for row in outcomes(campaign).values()),
        "the end of the campaign",
    )
    status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    assert '"left": 0' in status.stdout
    worker.terminate()
    assert worker.wait() == 0
    second.terminate()
    assert second.wait() == 1, "a verdict is not a pass"
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


def test_serving_a_campaign_until_it_is_done(marked, quiet, tmp_path):
    """It waits for workers of other hosts, and tells them to leave at the end."""
    folder = tmp_path / "c"
    child = marked.start(*serve_until_done(folder))
    worker = marked.start(
        *("twin", "worker", "--state", str(folder), "--wait", "60", "--until-done")
    )
    out, err = child.communicate()
    assert child.returncode == 1, err
    assert quiet["fingerprint"] in out
    _, said = worker.communicate()
    assert worker.returncode == 0, said
    assert "does not answer" not in said


def test_sigterm_of_a_campaign_served_until_it_is_done_is_unfinished(marked, quiet, tmp_path):
    """As at the end of a job's walltime: its worker is told to leave, the same command goes on."""
    folder = tmp_path / "c"
    join = ("twin", "worker", "--state", str(folder), "--wait", "60", "--until-done")
    child = marked.start(*serve_until_done(folder))
    worker = marked.start(*join)
    wait_for(lambda: committed(folder) >= 3, "three cases")
    child.terminate()
    _, err = child.communicate()
    assert child.returncode == 75, err
    assert "the same command goes on" in err
    _, said = worker.communicate()
    assert worker.returncode == 0, said
    again = marked.start(*serve_until_done(folder))
    worker = marked.start(*join)
    out, err = again.communicate()
    assert again.returncode == 1, err
    assert quiet["fingerprint"] in out
    assert all(row["charges"] == [] for row in outcomes(folder).values())
    worker.communicate()
    assert worker.returncode == 0


def serve_until_done(folder):
    """The command of a job script for ``chaos-16``."""
    return ("conductor", "serve", "--campaign", "chaos-16", "--until-done", "--state", str(folder))


def test_sigterm_of_a_run_is_unfinished(marked, quiet, tmp_path):
    """As at the end of the walltime: exit code 75, and the same command goes on."""
    folder = tmp_path / "c"
    rig = ("--workers", "1", "--slots", "4")
    command = ("conductor", "run", "chaos-16", "--out", str(folder), *rig)
    child = marked.start(*command)
    wait_for(lambda: committed(folder) >= 3, "three cases")
    child.terminate()
    _, err = child.communicate()
    assert child.returncode == 75, err
    again = marked.run(*command)
    assert again.returncode == 1, again.stderr
    assert quiet["fingerprint"] in again.stdout
    assert all(row["charges"] == [] for row in outcomes(folder).values())


def test_stop_of_a_run_is_unfinished(marked, tmp_path):
    folder = tmp_path / "c"
    child = marked.start("conductor", "run", "chaos-16", "--out", str(folder), "--workers", "1")
    wait_for(lambda: committed(folder) >= 3, "three cases")
    stopped = marked.run("conductor", "stop", "--state", str(folder))
    assert stopped.returncode == 0, stopped.stderr
    _, err = child.communicate()
    assert child.returncode == 75, err
    assert "the same command goes on" in err


def test_results_outlive_both_conductor_and_worker(marked, quiet, tmp_path):
    """Finished while the conductor was away, by a worker that is gone: its successor delivers."""
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    first = serve(marked, state)
    submitted = marked.run("conductor", "submit", "chaos-16", "--state", str(state))
    assert submitted.returncode == 0, submitted.stderr
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "4")
    wait_for(lambda: committed(campaign) >= 1, "a case")
    first.kill()
    first.wait()
    wait_for(lambda: list(state.glob("spool/*.result")), "a result in the spool")
    marked.one("sim").suspend()  # so that what is spooled stays what there is

    def written():
        """Nothing that was on its way is still being written."""
        before = sorted(state.glob("spool/*"))
        time.sleep(1.0)
        return before == sorted(state.glob("spool/*"))

    wait_for(written, "the worker has spooled what it has")
    worker.kill()
    worker.wait()
    spooled = {int(path.stem) for path in state.glob("spool/*.result")}
    second = serve(marked, state)
    successor = marked.start(
        *("twin", "worker", "--state", str(state), "--slots", "4", "--until-done")
    )
    _, said = successor.communicate()
    assert successor.returncode == 0, said
    assert f"{len(spooled)} results of earlier workers are delivered" in said
    second.terminate()
    second.wait()
    assert fingerprint(campaign).sha256 == quiet["fingerprint"]
    assert not (state / "spool").exists()
    journal = Journal(state)
    try:
        tokens = {f.result.token for f in journal.fold() if isinstance(f, Committed)}
    finally:
        journal.close()
    assert spooled <= tokens


def test_control_by_hand(marked, tmp_path):
    """Pause, explain, cancel, retry, drain: what people type."""
    state = tmp_path / "state"
    server = serve(marked, state)
    here = ("--state", str(state))
    assert marked.run("conductor", "submit", "chaos-16", *here).returncode == 0
    paused = marked.run("conductor", "pause", "chaos-16", *here)
    assert paused.stdout == "pause chaos-16: 16 cases\n"
    case = "yolov3-0500-clear"
    assert "paused" in marked.run("conductor", "explain", "chaos-16", case, *here).stdout
    unknown = marked.run("conductor", "explain", "chaos-16", "nope", *here)
    assert unknown.returncode == 2
    assert "nope" in unknown.stderr
    cancelled = marked.run("conductor", "cancel", "chaos-16", case, *here)
    assert cancelled.stdout == f"cancel chaos-16 {case}: 1 case\n"
    assert "cancelled" in marked.run("conductor", "explain", "chaos-16", case, *here).stdout
    assert marked.run("conductor", "retry", "chaos-16", case, *here).stdout.endswith("1 case\n")
    worker = marked.start("twin", "worker", *here)
    wait_for(lambda: workers(marked, here), "the worker")
    (name,) = workers(marked, here)
    assert not list(state.glob("chaos-16/cases/*")), "a paused campaign is not leased"
    assert marked.run("conductor", "drain", name, *here).returncode == 0
    worker.communicate()
    assert worker.returncode == 0
    server.terminate()
    server.communicate()
    assert server.returncode == 75, "unfinished"


def workers(marked, here):
    """Ids of the workers that the conductor knows."""
    found = json.loads(marked.run("conductor", "status", *here, "--output", "json").stdout)
    return [row["id"] for row in found["workers"]]
