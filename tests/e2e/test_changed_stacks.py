"""A run never mixes two versions of a stack: real runs of stacks of one's own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from foreign_campaigns import CLASS, CLIENT, campaign, python
from processes import interrupt, outcomes, wait_for
from tiny_networks import write_dark_spot_detector

from conductor.records.fingerprint import fingerprint
from twin.sandbox.possible import why_not

REPEATS = {"weather": ["clear"], "repeat": [0, 1, 2, 3, 4, 5, 6, 7]}
PACKAGE = CLASS.replace("self.gap_m = gap_m", "self.gap_m = gap_m + GAIN").replace(
    "from devkit.stack import Stack",
    "from pathlib import Path\nfrom devkit.stack import Stack\nfrom .gains import GAIN\n"
    "TABLE = (Path(__file__).parent / 'table.txt').read_text()",
)


@pytest.fixture
def stack(tmp_path, monkeypatch):
    """A stack of one's own: a package with a helper and data, on PYTHONPATH."""
    package = tmp_path / "code" / "mine"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "drive.py").write_text(PACKAGE)
    (package / "gains.py").write_text("GAIN = 0.0\n")
    (package / "table.txt").write_text("1 2 3\n")
    (package.parent / "further.py").write_text("OFFSET = 1\n")
    monkeypatch.setenv("PYTHONPATH", f"{package.parent}:{os.environ.get('PYTHONPATH', '')}")
    return package


def start(marked, path, out):
    """``conductor run``, by one worker."""
    return marked.start("conductor", "run", str(path), "--out", str(out), "--workers", "1")


def run(marked, path, out):
    """The same, to its end."""
    child = start(marked, path, out)
    stdout, stderr = child.communicate(timeout=300)
    return child.returncode, stdout, stderr


def interrupted(marked, path, out):
    """Run until a case has ended, and stop by Ctrl-C; the ended cases."""
    child = start(marked, path, out)
    # The second case is leased with the commit of the first.
    wait_for(lambda: len(list(out.glob("cases/*/attempt-*/kpi.parquet"))) > 1, "two cases")
    interrupt(child)
    child.communicate(timeout=120)
    assert child.returncode == 130
    return {case for case, row in outcomes(out).items() if row["outcome"]}


def refused(marked, path, out, *words):
    """``conductor run`` is refused in one line, which suggests another folder."""
    before = (out / "outcomes.json").read_bytes()
    code, stdout, stderr = run(marked, path, out)
    assert (code, stdout) == (2, ""), stderr
    # Zenoh may panic before, once in hundreds of conductors that end (test_quiet_ends).
    line = stderr.strip().splitlines()[-1]
    assert "panicked" in stderr or line == stderr.strip()
    assert "--out" in line
    assert all(word in line for word in words), line
    assert (out / "outcomes.json").read_bytes() == before


def digest_of(out):
    """Stack digest of a run, as its campaign file says it."""
    text = (out / "campaign.yaml").read_text()
    return text.partition("stack_identity:\n  digest: ")[2].partition("\n")[0]


def test_an_interrupted_run_goes_on_with_its_stack_and_no_other(marked, stack, tmp_path):
    path = campaign(tmp_path, "mixed", {"stack": "mine.drive:GapStack"}, matrix=REPEATS)
    out = tmp_path / "out"
    done = interrupted(marked, path, out)
    assert 0 < len(done) < 8
    original = (stack / "gains.py").read_text()
    (stack / "gains.py").write_text("GAIN = -20.0\n")
    refused(marked, path, out, "another version of the stack", "mine/gains.py has changed")
    other = tmp_path / "other"
    code, _, stderr = run(marked, path, other)
    assert code in (0, 1), stderr
    (stack / "gains.py").write_text(original)
    code, _, stderr = run(marked, path, out)
    assert code in (0, 1), stderr
    assert f"going on, {len(done)} of 8" in stderr
    assert all(row["attempts"] - len(row["charges"]) >= 1 for row in outcomes(out).values())
    assert digest_of(out)
    assert digest_of(out) != digest_of(other)
    assert fingerprint(out).sha256 != fingerprint(other).sha256


def test_a_finished_run_is_refused_with_a_changed_stack(marked, stack, tmp_path):
    path = campaign(tmp_path, "finished", {"stack": "mine.drive:GapStack"})
    out = tmp_path / "out"
    assert run(marked, path, out)[0] in (0, 1)
    assert "ended already" in run(marked, path, out)[2]
    (stack / "table.txt").write_text("4 5 6\n")
    refused(marked, path, out, "mine/table.txt has changed")
    # Data that no KPI depends on: another stack, the same fingerprint.
    other = tmp_path / "other"
    assert run(marked, path, other)[0] in (0, 1)
    assert digest_of(out) != digest_of(other)
    assert fingerprint(out).sha256 == fingerprint(other).sha256
    compared = marked.run("conductor", "compare", str(out), str(other), "--output", "json")
    sides = json.loads(compared.stdout)
    assert sides["before"]["stack"] == digest_of(out)
    assert sides["after"]["stack"] == digest_of(other)


def test_a_module_beside_the_package_counts(marked, stack, tmp_path):
    (stack / "gains.py").write_text("def f():\n    import further\n\nGAIN = 0.0\n")
    path = campaign(tmp_path, "beside", {"stack": "mine.drive:GapStack"})
    out = tmp_path / "out"
    assert run(marked, path, out)[0] in (0, 1)
    (stack.parent / "further.py").write_text("OFFSET = 2\n")
    refused(marked, path, out, "further.py has changed")


def test_the_same_model_elsewhere_resumes_and_another_is_refused(marked, tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    first.mkdir()
    second.mkdir()
    write_dark_spot_detector(first / "net.onnx")
    shutil.copy(first / "net.onnx", second / "moved.onnx")
    out = tmp_path / "out"

    def path(model):
        variants = {"perception": {"net": {"type": "network", "model": str(model)}}}
        return campaign(tmp_path, "model", variants, matrix=REPEATS)

    done = interrupted(marked, path(first / "net.onnx"), out)
    (first / "net.onnx").unlink()
    code, _, stderr = run(marked, path(second / "moved.onnx"), out)
    assert code in (0, 1), stderr
    assert f"going on, {len(done)} of 8" in stderr
    assert str(second / "moved.onnx") in (out / "campaign.yaml").read_text()
    write_dark_spot_detector(second / "moved.onnx", label="truck")
    refused(marked, path(second / "moved.onnx"), out, "moved.onnx")


def test_the_script_of_a_command_counts(marked, tmp_path):
    script = tmp_path / "client.py"
    script.write_text("import near\n" + CLIENT.read_text())
    (tmp_path / "near.py").write_text("A = 1\n")
    path = campaign(tmp_path, "script", {"command": python(script)})
    out = tmp_path / "out"
    code, _, stderr = run(marked, path, out)
    assert code in (0, 1), stderr
    (tmp_path / "near.py").write_text("A = 2\n")
    refused(marked, path, out, "near.py has changed")
    (tmp_path / "near.py").write_text("A = 1\n")
    script.write_text("import near\n" + CLIENT.read_text() + "\n")
    refused(marked, path, out, "autonomy.command[1] has changed")


@pytest.mark.parametrize("placement", ["worker", "inline"])
def test_a_module_that_no_import_statement_names_is_refused(marked, stack, tmp_path, placement):
    (stack / "gains.py").write_text(
        "import importlib\nGAIN = getattr(importlib.import_module('fur' + 'ther'), 'OFFSET')\n"
    )
    autonomy = {"stack": "mine.drive:GapStack", "placement": placement}
    if placement == "worker" and not why_not():
        sandboxed = campaign(tmp_path, "sandboxed", autonomy)
        code, _, stderr = run(marked, sandboxed, tmp_path / "sandboxed")
        assert code == 1, stderr
        assert "No module named 'further'; in its sandbox a stack sees what" in stderr
    if placement == "worker":
        autonomy["sandbox"] = "off"
    out = tmp_path / "out"
    code, _, stderr = run(marked, campaign(tmp_path, "dynamic", autonomy), out)
    assert code == 2, stderr
    assert f"loads {stack.parent / 'further.py'} otherwise" in stderr
    assert "autonomy.files" in stderr
    (row,) = outcomes(out).values()
    assert (row["outcome"], row["charges"]) == ("", [])
    named = campaign(tmp_path, "named", {**autonomy, "files": ["code/further.py"]})
    assert run(marked, named, tmp_path / "named")[0] in (0, 1)


def submitted(marked, path, state):
    """A conductor that serves, and a campaign submitted to it."""
    conductor = marked.start("conductor", "serve", "--state", str(state))
    wait_for(lambda: (state / "conductor.json").exists(), "the conductor")
    done = marked.run("conductor", "submit", str(path), "--state", str(state))
    assert done.returncode == 0, done.stderr
    return conductor


def notes(marked, state):
    """Why workers get no cases."""
    done = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    return json.loads(done.stdout)["notes"]


def finish(marked, state, out):
    """A worker, until all cases have ended."""
    done = marked.run("twin", "worker", "--state", str(state), "--until-done")
    assert done.returncode == 0, done.stderr
    return outcomes(out)


def stop(process):
    """SIGTERM, and wait."""
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)


@pytest.mark.parametrize("what", ["class", "command", "vehicle"])
def test_a_file_that_changed_after_the_submission_charges_no_case(marked, stack, tmp_path, what):
    script, vehicle = tmp_path / "client.py", tmp_path / "car.yaml"
    shutil.copy(CLIENT, script)
    models = Path(sys.modules["conductor"].__file__).parents[1] / "twin/vehicle/models"
    shutil.copy(models / "opencav.yaml", vehicle)
    autonomy = (
        {"command": python(script)} if what == "command" else {"stack": "mine.drive:GapStack"}
    )
    path = campaign(tmp_path, "later", autonomy)
    if what == "vehicle":
        content = json.loads(path.read_text())
        content["scenario"]["vehicle"] = str(vehicle)
        path.write_text(json.dumps(content))
    changed = {"class": stack / "gains.py", "command": script, "vehicle": vehicle}[what]
    state = tmp_path / "state"
    conductor = submitted(marked, path, state)
    before = changed.read_text()
    changed.write_text(before + "\n# another version\n")
    worker = marked.start("twin", "worker", "--state", str(state))
    (line,) = wait_for(lambda: notes(marked, state), "the refusal")
    assert "\n" not in line
    assert "submitted" in line
    assert "--out" in line
    assert "gets no case of campaign 'later'" in line
    stop(worker)
    changed.write_text(before)
    (row,) = finish(marked, state, state / "later").values()
    assert (row["outcome"], row["charges"]) == ("verdict", [])
    stop(conductor)


def test_a_stack_on_another_node_is_confirmed_there(marked, stack, tmp_path):
    path = campaign(tmp_path, "far", {"stack": "mine.drive:GapStack", "placement": "node"})
    state, rigs = tmp_path / "state", tmp_path / "rigs"
    conductor = submitted(marked, path, state)
    (stack / "gains.py").write_text("GAIN = 3.0\n")
    rigs.mkdir()
    host = marked.start("devkit", "host", "--join", str(rigs))
    worker = marked.start("twin", "worker", "--state", str(state), "--join-dir", str(rigs))
    (line,) = wait_for(lambda: notes(marked, state), "the refusal")
    assert "mine/gains.py has changed" in line
    stop(worker)
    (stack / "gains.py").write_text("GAIN = 0.0\n")
    done = marked.run(
        *("twin", "worker", "--state", str(state), "--until-done", "--join-dir", str(rigs))
    )
    assert done.returncode == 0, done.stderr
    (row,) = outcomes(state / "far").values()
    assert (row["outcome"], row["charges"]) == ("verdict", [])
    stop(host)
    stop(conductor)
