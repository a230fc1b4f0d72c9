"""Which records ``devkit replay`` takes, and what it says if there are none."""

import pytest

from devkit.replaying.replay import find_records
from twin.base.errors import UsageError


@pytest.fixture
def run(tmp_path):
    for case, attempt in (("fog", 1), ("fog", 2), ("fog", 10), ("clear", 1)):
        folder = tmp_path / "run/cases" / case / f"attempt-{attempt}"
        folder.mkdir(parents=True)
        (folder / "drive.record").write_bytes(b"")
    (tmp_path / "run/cases/rain/attempt-1").mkdir(parents=True)
    return tmp_path / "run"


def test_the_last_attempt_with_a_record_is_taken(run):
    def names(*asked):
        return [str(path.parent.relative_to(run / "cases")) for path in find_records(run, *asked)]

    assert names([], None) == ["clear/attempt-1", "fog/attempt-10"]
    assert names(["fog"], None) == ["fog/attempt-10"]
    assert names(["fog"], 2) == ["fog/attempt-2"]
    attempt = run / "cases/fog/attempt-1"
    assert find_records(attempt, [], None) == [attempt]
    file = attempt / "drive.record"
    assert find_records(file, [], None) == [file]


def test_what_is_not_there_is_said_in_one_line(run, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, cases, attempt, words in (
        (tmp_path / "none", [], None, "no such folder"),
        (empty, [], None, r"recording: \{drive: all\}"),
        (run, ["rain"], None, r"no record of case rain; there are 2, as in clear \(1\)"),
        (run, ["fog"], 9, "no record of attempt 9 of case fog"),
        (run / "cases/fog/attempt-1", ["fog"], None, "leave fog out"),
        (run / "cases/fog/attempt-1", [], 7, "leave --attempt out"),
    ):
        with pytest.raises(UsageError, match=words) as caught:
            find_records(folder, cases, attempt)
        assert "\n" not in str(caught.value)
