"""Failed tests run once more only where that hides nothing."""

import os
import subprocess
import sys
from pathlib import Path

import again
import pytest

SCRIPT = Path(again.__file__)
CONFTEST = """\
from again import Ends


def pytest_configure(config):
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Ends())
"""
ONCE = """\
from pathlib import Path


def first(name):
    ran = Path(name)
    there = ran.exists()
    ran.touch()
    return not there
"""


def ends(exit_code=1, **tests):
    return {"exit": exit_code, "tests": {"crashed": [], "never ended": [], **tests}}


@pytest.fixture
def suite(tmp_path):
    """Runs the script with tests of a folder of its own; what it says, its exit code and the runs.

    The command stands for ``make``: it takes ``ARGS=...`` and hands it to pytest.
    """
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "once.py").write_text(ONCE)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    command = tmp_path / "command"
    command.write_text(
        "#!/bin/sh\necho run >> runs\nARGS=${1#ARGS=}\n"
        f'exec "{sys.executable}" -m pytest ${{ARGS:-$FIRST}}\n'
    )
    command.chmod(0o755)
    outside = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}

    def run(text, *, first="-n 1", **files):
        (tmp_path / "test_few.py").write_text(
            f"import pytest\nfrom once import first\n\n\n{text}\n"
        )
        for name, content in files.items():
            (tmp_path / f"{name}.py").write_text(content)
        ran = subprocess.run(
            [sys.executable, SCRIPT, "./command"],
            cwd=tmp_path,
            env={**outside, "FIRST": first, "PYTHONPATH": str(SCRIPT.parent)},
            capture_output=True,
            text=True,
        )
        said = [
            line
            for line in ran.stdout.splitlines()
            if line.startswith(("again:", "flaky:", "failed again:"))
        ]
        return ran.returncode, said, (tmp_path / "runs").read_text().count("run")

    return run


RACE = "def test_race():\n    assert not first('race')\n"


def test_one_that_passes_alone_is_named_flaky(suite):
    code, said, runs = suite(f"{RACE}\n\ndef test_well():\n    assert True")
    assert (code, runs) == (0, 2)
    assert said == ["again: 1 failed and run once more, alone", "flaky: test_few.py::test_race"]


def test_one_that_fails_twice_fails_the_run_and_the_flaky_one_is_named_all_the_same(suite):
    code, said, runs = suite(f"{RACE}\n\ndef test_wrong():\n    assert first('x') is None")
    assert (code, runs) == (1, 2)
    assert said[1:] == ["flaky: test_few.py::test_race", "failed again: test_few.py::test_wrong"]


def test_a_fixture_that_fails_twice_behind_its_test_fails_the_run(suite):
    fixture = "@pytest.fixture\ndef thing():\n    yield\n    assert False\n\n\n"
    code, said, _ = suite(f"{fixture}def test_thing(thing):\n    assert True")
    assert code == 1
    assert said[-1] == "failed again: test_few.py::test_thing"


def test_one_that_is_skipped_then_has_not_passed(suite):
    code, said, runs = suite(
        "def test_a():\n    if not first('a'):\n        pytest.skip('not here')\n    assert False"
    )
    assert (code, runs) == (1, 2)
    assert said[-1] == "failed again: test_few.py::test_a"


def test_all_passed_is_one_run(suite):
    assert suite("def test_well():\n    assert True") == (0, [], 1)


def test_what_is_not_collected_has_no_second_chance(suite):
    code, said, runs = suite(RACE, test_broken="import nothing_of_this_name\n")
    assert (code != 0, runs) == (True, 1)
    assert "no second chance: not collected: test_broken.py" in said[0]


def test_a_run_that_is_cut_off_has_no_second_chance(suite):
    code, said, runs = suite(
        f"{RACE}\n\ndef test_end():\n    pytest.exit('enough', returncode=1)", first="-v"
    )
    assert (code, runs) == (1, 1)
    assert said == [
        "again: no second chance: 1 tests did not come to their end: test_few.py::test_end, ..."
    ]


def test_a_process_that_dies_has_no_second_chance(suite):
    code, said, runs = suite(
        "import os\n\n\ndef test_death():\n    if first('dead'):\n        os._exit(1)"
    )
    assert (code, runs) == (1, 1)
    assert said == ["again: no second chance: the process of a test died: test_few.py::test_death"]


def test_a_command_without_tests_and_what_an_earlier_run_left(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    stale = again.CACHE / again.ENDS
    stale.parent.mkdir(parents=True)
    stale.write_text('{"exit": 1, "tests": {"crashed": [], "failed": ["test_a.py::test_a"]}}')
    assert again.main(["false"]) == 1
    assert "pytest did not come to its end" in capsys.readouterr().out
    assert again.main(["sh", "-c", "kill -TERM $$"]) == 143
    assert again.main([]) == 2


@pytest.mark.parametrize(
    ("kept", "reason"),
    [
        (None, "did not come to its end"),
        (
            ends(**{"failed": ["t.py::test_a"], "never ended": ["t.py::test_b"]}),
            "t.py::test_b, ...",
        ),
        (ends(failed=[f"t.py::test_{i}" for i in range(4)]), "4 tests failed; at most 3"),
        (ends(failed=["t.py::test_a"], error=[f"t.py::test_{i}" for i in range(3)]), "4 tests"),
        (ends(2, failed=["t.py::test_a"]), "ended with 2"),
        (ends(1), "ended with 1, not with tests that failed"),
        (ends(failed=["tests/golden/test_x.py::test_a"]), "must be the same"),
        (ends(failed=["t.py::test_Determinism[4]"], error=["t.py::test_a"]), "test_Determinism[4]"),
        (ends(failed=["t.py::test_a[digest]"]), "must be the same"),
        (ends(failed=["t.py::test_neighbours_change_no_byte_of_it"]), "must be the same"),
        (ends(failed=["t.py::test_slots_to_the_last_bit"]), "must be the same"),
        (ends(failed=["t.py::test_a_rerun_is_identical"]), "must be the same"),
        (ends(2, error=["t.py"]), "not collected: t.py"),
    ],
)
def test_reasons_to_run_nothing_again(kept, reason):
    assert reason in again.refusal(kept)


def test_three_that_failed_in_whatever_phase_run_again():
    kept = ends(failed=["t.py::test_a", "t.py::test_b"], error=["t.py::test_b", "t.py::test_c"])
    assert again.refusal(kept) is None
    assert again.failed_tests(kept) == ["t.py::test_a", "t.py::test_b", "t.py::test_c"]
