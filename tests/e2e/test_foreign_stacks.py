"""Stacks in processes of their own: the same values as a class, and a reason for every failure."""

import json
import re

import pyarrow.parquet as parquet
from foreign_campaigns import CLASS, CLIENT, FAULTS, HOSTILE, campaign, faulty, python
from processes import outcomes, wait_for

from twin.records.kpi_file import kpi_sha256


def run(marked, path, *options):
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "1", "--output", "json"),
        *("--out", str(path.parent / f"run-{path.stem}"), *options),
    )
    return done, path.parent / f"run-{path.stem}"


def test_sixty_lines_of_python_give_the_values_of_the_class(marked, tmp_path, monkeypatch):
    """Also beside more slots than it drives, and with the words of a later minor version."""
    assert len(CLIENT.read_text().splitlines()) <= 60
    (tmp_path / "gapstack.py").write_text(CLASS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    later = tmp_path / "later.py"
    source = CLIENT.read_text().replace('"role": "stack"', '"minor": 9, "mood": 1, "role": "stack"')
    later.write_text(source.replace('{"steering_rad": 0.0', '{"horn": True, "steering_rad": 0.0'))
    assert '"horn"' in later.read_text()
    assert '"mood"' in later.read_text()
    matrix = {"matrix": {"weather": ["clear", "heavy_fog"]}}
    given = {"parameters": {"gap_m": 18.0}}
    found = {}
    for name, driver in {
        "class": {"stack": "gapstack:GapStack"},
        "client": {"command": python(CLIENT)},
        "later": {"command": python(later)},
    }.items():
        path = campaign(tmp_path, name, {**driver, **given}, **matrix)
        done, _ = run(marked, path, "--slots", "2")
        assert done.returncode == 0, done.stderr
        found[name] = json.loads(done.stdout)["fingerprint"]
    assert len(set(found.values())) == 1, found


def test_every_failure_has_its_reason_and_the_last_words(marked, tmp_path):
    autonomy = {"command": python(faulty(tmp_path, FAULTS))}
    path = campaign(
        *(tmp_path, "faults", autonomy),
        matrix={"repeat": list(range(len(FAULTS)))},
        attempts_max=1,
        deadline_s=15,
    )
    done, folder = run(marked, path)
    assert done.returncode == 3, done.stderr
    cases = outcomes(folder)
    said = {fault: cases[f"repeat_{i}"] for i, fault in enumerate(FAULTS)}
    reasons = {fault: " ".join(case["reasons"]) for fault, case in said.items()}
    for fault, reason in reasons.items():
        assert f"now comes {fault}" in reason, reason
    # What the stack does by itself it does in every attempt; what ends it, and time, may differ.
    own = {"nan", "range", "exit", "tick", "token", "garbage", "silent", "major"}
    own |= {"twice", "slot", "seq"}
    for fault in FAULTS:
        assert said[fault]["outcome"] == ("failed" if fault in own else "unresolved"), fault
        assert said[fault]["attempts"] == 1
    assert "throttle is nan, allowed: 0 to 1, at tick 3" in reasons["nan"]
    assert "brake is 1.5, allowed: 0 to 1, at tick 3" in reasons["range"]
    assert "stack exit code 7" in reasons["exit"]
    assert "crash: stack killed by SIGSEGV" in reasons["crash"]
    assert "deadline: case repeat_2: no progress for 15 s at tick 3" in reasons["hang"]
    assert "is for tick 4, expected 3; echo" in reasons["tick"]
    token, expected = re.search(
        r"is for token (\d+), expected (\d+); echo", reasons["token"]
    ).groups()
    assert int(token) == int(expected) + 1
    assert "stack: not MessagePack" in reasons["garbage"]
    assert "stack: no command for case repeat_7" in reasons["silent"]
    assert "stack: two commands for case repeat_10" in reasons["twice"]
    assert "stack: command for slot 1, which is not active" in reasons["slot"]
    assert "stack: answers seq 4, asked for 3; echo the tick's" in reasons["seq"]
    assert "schema version 0 given, this side speaks 1" in reasons["major"]


def test_a_hostile_stack_ends_its_rig_and_nothing_else(marked, tmp_path):
    """Other cases have the values of a peaceful stack; the fixture looks for what is left."""
    matrix = {"matrix": {"repeat": list(range(len(HOSTILE)))}}
    autonomy = {"command": python(faulty(tmp_path, HOSTILE))}
    path = campaign(tmp_path, "hostile", autonomy, **matrix, attempts_max=1, deadline_s=30)
    done = marked.run(
        *("conductor", "run", str(path), "--workers", "2", "--output", "json"),
        *("--out", str(tmp_path / "hostile")),
    )
    assert done.returncode == 3, done.stderr
    cases = outcomes(tmp_path / "hostile")
    reasons = {fault: " ".join(cases[f"repeat_{i}"]["reasons"]) for i, fault in enumerate(HOSTILE)}
    # The same answer again and again: it is found out by its seq, or by what waits.
    assert re.search(r"stack: (answers seq 3, asked for 4|more than 1000 mess)", reasons["flood"])
    assert "no message comes of it; at most 16777216 bytes in one are accepted" in reasons["giant"]
    assert "runs more than 256 processes" in reasons["forks"]
    assert "stack exit code 9" in reasons["orphans"]
    told = [line for line in done.stderr.splitlines() if line.startswith("worker ")]
    assert all(": rig ended" in line for line in told), "no worker died"
    path = campaign(tmp_path, "peaceful", {"command": python(CLIENT)}, **matrix)
    done, peaceful = run(marked, path)
    assert done.returncode == 0, done.stderr
    for index in (0, len(HOSTILE) - 1):
        assert values(tmp_path / "hostile", index) == values(peaceful, index)


def values(folder, index):
    """Digest of all KPI values of a case."""
    (kpi,) = folder.glob(f"cases/repeat_{index}/attempt-*/kpi.parquet")
    return kpi_sha256(parquet.read_table(kpi))


def test_a_killed_worker_leaves_nothing_of_a_foreign_stack(marked, tmp_path):
    """Also not what the stack started in sessions of its own; the fixture looks for it."""
    script = tmp_path / "stack.sh"
    script.write_text("setsid sleep 601 &\nexec sleep 602\n")
    path = campaign(tmp_path, "killed", {"command": ["sh", str(script)]})
    state = ("--state", str(tmp_path / "state"))
    conductor = marked.start("conductor", "serve", *state)
    conductor.stdout.readline()
    done = marked.run("conductor", "submit", str(path), *state)
    assert done.returncode == 0, done.stderr
    worker = marked.start("twin", "worker", *state)
    for words in (("sleep", "601"), ("sleep", "602")):
        marked.one(*words)
    worker.kill()
    worker.wait()
    for word in ("601", "602"):
        wait_for(lambda word=word: not marked.processes("sleep", word), f"the end of sleep {word}")
    conductor.terminate()
    conductor.wait()
