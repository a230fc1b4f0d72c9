"""The console beside a real conductor: it is killed and comes back, and roles may what they may."""

import json
import signal

from console_pages import ConsolePage
from processes import PATIENCE_S, keys_of, outcomes, wait_for
from test_conductor_restart import serve

from twin.fabric.discovery import find_conductor


def console(marked, *arguments):
    """`viewer web` in the background, and its address."""
    child = marked.start("viewer", "web", *arguments, "--output", "json")
    line = child.stdout.readline()
    assert line, child.stderr.read()
    return child, json.loads(line)["url"]


def ended(*children):
    """End processes as Ctrl-C does."""
    for child in children:
        child.send_signal(signal.SIGINT)
        child.wait(PATIENCE_S)


def test_a_page_heals_after_the_conductor_and_the_network_were_gone(marked, tmp_path):
    """Events and deltas alone make the table of a page the same as that of the finished run."""
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    first = serve(marked, state)
    submitted = marked.run("conductor", "submit", "chaos-16", "--state", str(state))
    assert submitted.returncode == 0, submitted.stderr
    child, url = console(marked, "--state", str(state))
    page = ConsolePage(url, "chaos-16")
    page.follow()
    wait_for(lambda: len(page.verdicts()) == 16, "the campaign on the page")
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "2")
    wait_for(lambda: sum(map(bool, page.verdicts().values())) >= 2, "two verdicts on the page")
    first.kill()
    first.wait()
    page.cut()
    second = serve(marked, state)
    wait_for(lambda: all(row["outcome"] for row in outcomes(campaign).values()), "the end")
    page.follow()
    wait_for(lambda: all(page.verdicts().values()), "all verdicts on the page")
    assert [hello["resync"] for hello in page.hellos] == [False, False], "nothing was lost"
    assert page.verdicts() == {name: row["verdict"] for name, row in outcomes(campaign).items()}
    served = page.data("runs/chaos-16/table.json")
    wait_for(lambda: page.table["columns"]["verdict"] == served["columns"]["verdict"], "the table")
    (row,) = page.data("runs.json")["runs"]
    assert (row["state"], row["cases"], row["done"]) == ("finished", 16, 16)
    assert page.gone == []
    ended(child)
    assert child.returncode == 0
    assert "chaos-16" not in child.stderr.read()
    ended(worker, second)


def test_who_may_look_and_who_may_operate(marked, tmp_path):
    state, look = tmp_path / "state", str(tmp_path / "viewer.key")
    conductor = serve(marked, state)
    invite = ("conductor", "invite", "--role", "viewer", "--state", str(state), "-o", look)
    assert marked.run(*invite).returncode == 0
    submitted = marked.run("conductor", "submit", "chaos-16", "--state", str(state))
    assert submitted.returncode == 0, submitted.stderr
    endpoint = find_conductor(state).endpoint
    seen, seen_url = console(marked, "--connect", endpoint, "--key", look)
    kept, kept_url = console(marked, "--connect", endpoint, "--key", str(keys_of(state)))
    viewer, admin = (ConsolePage(url, "chaos-16") for url in (seen_url, kept_url))
    for page in (viewer, admin):
        wait_for(lambda page=page: page.data("runs.json")["runs"], "the campaign")
    assert viewer.data("runs.json", **{"X-Steer-Token": viewer.token})["roles"] == "look"
    assert admin.data("runs.json", **{"X-Steer-Token": admin.token})["roles"] == "operate"
    assert admin.data("runs.json")["roles"] == "look", "without the printed address"
    status, answer = viewer.act("pause", run="chaos-16", confirm=True)
    assert status == 409
    assert "role viewer" in answer["error"]
    assert not paused(marked, state)
    status, answer = admin.act("pause", run="chaos-16")
    assert (status, paused(marked, state)) == (200, False), "it is told first"
    status, answer = admin.act("pause", run="chaos-16", confirm=True)
    assert (status, answer) == (200, {"done": "pause chaos-16: 16 cases"})
    assert paused(marked, state)
    wait_for(lambda: viewer.data("runs.json")["runs"][0]["paused"], "the pause on both pages")
    admin.token = viewer.token
    assert admin.request("POST", "/act/resume", "{}", {})[0] == 403
    status, _ = admin.request(
        *("POST", "/act/resume", json.dumps({"run": "chaos-16", "confirm": True})),
        {
            "Origin": f"http://{admin.host}",
            "Content-Type": "application/json",
            "X-Steer-Token": viewer.token,
        },
    )
    assert (status, paused(marked, state)) == (403, True), "another console's token"
    ended(seen, kept, conductor)


def test_mistakes_are_one_line(marked, quiet, tmp_path):
    run, full = str(quiet["folder"]), tmp_path / "full"
    full.mkdir()
    (full / "x").touch()
    done = [
        (marked.start("viewer", "web", *arguments), words)
        for arguments, words in [
            ([run, "--recordings"], "belongs to --static"),
            (["--run", run, "--static", str(tmp_path / "out")], "viewer web DIR --static OUT"),
            ([run, "case", "--static", str(tmp_path / "out")], "viewer web DIR --static OUT"),
            ([run, "--static", str(full)], "not empty"),
            ([run, "--static", f"{run}/static"], "lies in the run"),
            ([run, "--case", "x"], "--case is for running cases"),
            ([run, "--ssh", "me@login"], "--ssh is for running cases; give --run FOLDER"),
        ]
    ]
    for child, words in done:
        _, err = child.communicate(timeout=PATIENCE_S)
        assert child.returncode == 2, err
        assert words in err
        assert len(err.splitlines()) == 1


def test_a_run_that_has_ended_is_shown_as_one(marked, quiet):
    """Also where somebody still asks for what runs."""
    child, url = console(marked, "--run", str(quiet["folder"]))
    page = ConsolePage(url, "x")
    found = page.data("runs.json")
    assert (found["live"], found["roles"]) == (False, "look")
    assert [row["state"] for row in found["runs"]] == ["finished"]
    assert page.token == "", "there is nothing to operate"
    ended(child)
    assert child.returncode == 0


def paused(marked, state):
    """Whether the conductor says so."""
    status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    return json.loads(status.stdout)["campaigns"]["chaos-16"]["paused"]
