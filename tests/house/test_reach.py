"""The reach of a commit is counted right, and the recorded ones keep their limits."""

import re
import subprocess

import pytest
from reach import LIMITS, ROOT, reach


def git(root, *words):
    names = ("-c", "user.name=test", "-c", "user.email=test@localhost")
    command = ["git", "-C", str(root), *names, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def house(tmp_path):
    """A repository, and what commits files to it; the commit's hash."""
    git(tmp_path, "init", "-q")

    def commit(subject, *names):
        for name in names:
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(subject)
        git(tmp_path, "add", "-A")
        git(tmp_path, "commit", "-q", "-m", subject)
        return git(tmp_path, "rev-parse", "HEAD")

    there = (
        "twin/scenario/protocol.py",
        "schemas/kinds/scenario.py",
        "hpc/cli.py",
        "viewer/cli.py",
    )
    commit("Begin", *there, "pyproject.toml")
    return tmp_path, commit


def test_what_lies_outside_the_new_folder_counts(house):
    root, commit = house
    own = ("twin/scenario/gate/family.py", "twin/scenario/gate/deep/inner.py")
    rest = ("docs/gate.md", "tests/test_gate.py")
    made = commit("Scenario: a gate", *own, "schemas/kinds/gate.py", "pyproject.toml", *rest)
    found = reach(made, root)
    assert (found.kind, found.own) == ("Scenario", "twin/scenario/gate")
    assert found.outside == ["pyproject.toml", "schemas/kinds/gate.py"]
    assert found.kept


def test_a_second_folder_is_no_own_one(house):
    root, commit = house
    own = ("hpc/flux/commands.py", "hpc/flux/script.py")
    made = commit("Batch system: flux", *own, "viewer/flux/look.py", "schemas/a.py", "twin/b.py")
    found = reach(made, root)
    assert found.own == "hpc/flux"
    assert found.outside == ["schemas/a.py", "twin/b.py", "viewer/flux/look.py"]
    assert not found.kept


def test_a_moved_file_counts_at_both_places(house):
    root, commit = house
    git(root, "mv", "twin/scenario/protocol.py", "twin/scenario/moved.py")
    found = reach(commit("KPI: a jerk"), root)
    assert found.own == ""
    assert found.outside == ["twin/scenario/moved.py", "twin/scenario/protocol.py"]


def test_a_subject_that_does_not_say_what_it_adds(house):
    root, commit = house
    with pytest.raises(ValueError, match="begins with none of Sensor, Scenario, KPI"):
        reach(commit("Mend", "twin/a.py"), root)


RECORD = (ROOT / "docs/decisions/0027-what-a-kind-touches.md").read_text()
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| `([^`]+)` \| (\d+) \| (\d+) \|$", re.MULTILINE)


def test_the_record_has_rows_of_every_kind_that_it_is_about():
    kinds = {what.partition(":")[0] for _, what, *_ in ROW.findall(RECORD)}
    assert {"Scenario", "KPI", "Batch system"} <= kinds <= {*LIMITS}


@pytest.mark.parametrize("row", ROW.findall(RECORD), ids=lambda row: row[0])
def test_a_recorded_commit_touches_what_the_record_says(row):
    commit, what, own, outside, limit = row
    try:
        found = reach(commit)
    except (subprocess.CalledProcessError, FileNotFoundError):
        pytest.skip("a copy without the history")
    assert (found.subject, found.own) == (what.strip(), own)
    assert (len(found.outside), LIMITS[found.kind]) == (int(outside), int(limit))
    assert found.kept
