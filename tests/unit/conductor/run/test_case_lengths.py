"""What a run says of the earlier one that knows its cases."""

from pathlib import Path

from conductor.run.case_lengths import history_line


def test_how_many_cases_are_known_is_said():
    lengths = {"a": 1.0, "b": 2.0, "elsewhere": 3.0}
    folder = Path("runs/old")
    assert history_line(folder, lengths, ["a", "b"]) == "history: runs/old knows 2 of 2 cases"
    some = history_line(folder, lengths, ["a", "c", "d"])
    assert some == "history: runs/old knows 1 of 3 cases; the others begin as in the file"
    assert "knows 0 of 1 case;" in history_line(folder, {}, ["x"])
    assert history_line(None, {}, ["a"]) == ""
