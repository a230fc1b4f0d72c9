"""The fingerprint does not depend on workers, slots, load, crashes or where processes run."""

import json
import re
import shutil
import subprocess
import sys

import pyarrow.parquet as pq
import pytest
from changed_campaigns import changed, from_nearby
from processes import committed, outcomes, wait_for
from served_campaign import ServedCampaign


def run(marked, folder, *options, campaign="chaos-16"):
    """Run a campaign; its JSON."""
    done = marked.run(
        "conductor", "run", campaign, "--out", str(folder), "--output", "json", *options
    )
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)


def test_quiet_run_has_two_verdicts(quiet):
    assert quiet["committed"] == quiet["cases"] == 16
    assert 0 < quiet["no_collision"] < 16
    assert quiet["passed"] + quiet["failed"] == 16
    assert quiet["unresolved"] == 0
    assert {row["verdict"] for row in outcomes(quiet["folder"]).values()} == {
        "collision",
        "time_up",  # two seconds are too short for a stop
    }


@pytest.mark.parametrize(("workers", "slots", "load"), [(1, 4, 0), (2, 2, 4)])
def test_workers_slots_and_load(marked, quiet, tmp_path, workers, slots, load):
    """Beside ``load`` processes that want a core each."""
    spin = [sys.executable, "-c", "while True: pass"]
    burners = [subprocess.Popen(spin) for _ in range(load)]
    try:
        found = run(marked, tmp_path / "c", "--workers", str(workers), "--slots", str(slots))
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    assert found["committed"] == 16
    assert found["fingerprint"] == quiet["fingerprint"]
    done = marked.run("conductor", "compare", str(quiet["folder"]), str(tmp_path / "c"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(
        f"identical (bytes): 16 cases, fingerprint {found['fingerprint']}"
    )


def test_an_earlier_run_changes_the_order_and_no_byte(marked, quiet, tmp_path):
    lengths = {name: c["scalars"]["sim_time_s"] for name, c in outcomes(quiet["folder"]).items()}
    words = ("run", "chaos-16", "--workers", "1", "--slots", "4", "--out", str(tmp_path / "c"))
    done = marked.run("conductor", *words, "--history", str(quiet["folder"]))
    assert done.returncode == 1, done.stderr
    assert f"fingerprint {quiet['fingerprint']}" in done.stdout
    assert re.search(r"^slots: [1-4]\.\d of 4 in use on average \(\d+%\)$", done.stdout, re.M)
    begun = [lengths[case] for case in leased(tmp_path / "c")]
    assert begun == sorted(begun, reverse=True)
    assert len(set(begun)) > 1


def leased(folder):
    """Cases as they were leased."""
    lines = (folder / "timeline.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    return [event["case"] for event in events if event["event"] == "leased"]


def test_a_conductor_that_serves_knows_an_earlier_run_too(marked, quiet, tmp_path):
    lengths = {name: c["scalars"]["sim_time_s"] for name, c in outcomes(quiet["folder"]).items()}
    served = ServedCampaign(marked, tmp_path)
    served.start("--history", str(quiet["folder"]))
    done = marked.run("conductor", "submit", "chaos-16", "--state", str(served.state))
    assert done.returncode == 0, done.stderr
    served.worker()
    wait_for(served.complete, "every case")
    begun = [lengths[case] for case in leased(served.campaign)]
    assert begun == sorted(begun, reverse=True)
    served.finish()


@pytest.mark.parametrize("words", [("run", "chaos-16", "--out"), ("serve", "--state")])
def test_a_history_that_is_none_is_refused_before_anything_is_written(marked, tmp_path, words):
    done = marked.run("conductor", *words, str(tmp_path / "c"), "--history", str(tmp_path / "no"))
    assert done.returncode == 2
    assert "--history: " in done.stderr
    assert "give the folder of an earlier run" in done.stderr
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("victim", ["worker", "sim", "host"])
def test_a_process_killed_in_the_middle(marked, quiet, tmp_path, victim):
    folder = tmp_path / "c"
    child = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "2", "--slots", "2"),
        *("--out", str(folder), "--output", "json"),
    )
    wait_for(lambda: committed(folder) >= 3, "three cases")
    marked.one(victim).kill()
    out, err = child.communicate()
    assert child.returncode == 1, err
    found = json.loads(out)
    assert found["committed"] == 16
    assert found["fingerprint"] == quiet["fingerprint"]
    rows = outcomes(folder)
    assert sum(row["attempts"] for row in rows.values()) > 16, "nothing was lost by the kill"
    assert all(not row["late"] for row in rows.values())
    assert not list(folder.rglob("*.tmp"))
    wait_for(lambda: not marked.processes(), "the end of every process, by itself")


def test_another_seed_changes_it(marked, quiet, tmp_path):
    found = run(marked, tmp_path / "c", "--seed", "17", "--workers", "1", "--slots", "4")
    assert found["fingerprint"] != quiet["fingerprint"]
    asked = ("conductor", "compare", str(quiet["folder"]), str(tmp_path / "c"))
    compared = json.loads(marked.run(*asked, "--output", "json").stdout)
    assert not compared["identical"]
    assert compared["pairs"] == 16
    assert any("'seed' differs in 16 of 16 pairs" in note for note in compared["notes"])


def test_a_changed_kpi_file_is_noticed(marked, quiet, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(quiet["folder"], folder)
    done = marked.run("conductor", "fingerprint", str(folder))
    assert done.stdout.split() == [quiet["fingerprint"]]
    path = next(folder.glob("cases/*/attempt-1/kpi.parquet"))
    table = pq.read_table(path)
    speed = table.column("speed_mps").to_pylist()
    speed[3] += 1e-15
    index = table.schema.get_field_index("speed_mps")
    pq.write_table(table.set_column(index, table.schema.field(index), [speed]), path)
    done = marked.run("conductor", "fingerprint", str(folder))
    assert done.returncode == 3
    assert path.parent.parent.name in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_demo_campaign_alone_and_together(marked, local, tmp_path):
    """Real networks: eight cars one by one, and four at a time."""
    folder = local["folder"]
    path = changed(tmp_path, "aeb-demo", from_nearby)
    other = run(marked, tmp_path / "b", "--workers", "1", "--slots", "4", campaign=path)
    assert local["committed"] == 8
    assert local["passed"] + local["failed"] == 8
    assert local["fingerprint"] == other["fingerprint"]
    ended = outcomes(folder).values()
    assert all(row["scalars"]["aeb_time_s"] for row in ended), "its network was heard"
    assert (folder / "report.html").stat().st_size > 10_000
    summary = pq.read_table(folder / "summary.parquet")
    assert summary.num_rows == 8
    used = pq.read_table(folder / "resources.parquet")
    assert len(set(used.column("worker").to_pylist())) == 2
    assert max(used.column("cpu_cores").to_pylist()) > 0.05
    assert {"worker", "simulator", "stack"} <= {
        process["role"] for row in used.column("processes").to_pylist() for process in row
    }
    assert not (folder / "resources").exists()
