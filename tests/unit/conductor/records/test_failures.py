"""Failures on the terminal: one group per reason, the last frames, and where the log is."""

from conductor.records.failures import FRAME_LINES_MAX, GROUPS_MAX, told
from conductor.records.outcomes import CaseOutcome, Outcomes

TRACEBACK = """printed before
Traceback (most recent call last):
  File "host.py", line 1, in step
    return stack.step(observation)
           ^^^^^^^^^^^^^^^^^^^^^^^
  File "mystack.py", line 7, in step
    raise RuntimeError("lens cap on")
RuntimeError: lens cap on
printed after
"""


def outcomes(**cases):
    head = {"campaign": "c", "digest": "", "seed": 0, "simulator": "warp", "software": ""}
    return Outcomes(**head, device="same", device_classes=[], complete=True, cases=cases)


def failed(reason, **changes):
    return CaseOutcome(**{"outcome": "failed", "reasons": [reason], "attempt": 1, **changes})


def log(folder, case, attempt=1, text=TRACEBACK):
    path = folder / f"cases/{case}/attempt-{attempt}/log.txt"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    return path


def test_a_failure_is_told_with_its_last_frames_and_the_path_of_its_log(tmp_path):
    path = log(tmp_path, "a")
    cases = {"a": failed("RuntimeError: lens cap on"), "b": failed("RuntimeError: lens cap on")}
    assert told(tmp_path, outcomes(**cases, c=CaseOutcome(outcome="verdict"))) == [
        "a (and 1 more) failed: RuntimeError: lens cap on",
        '    File "host.py", line 1, in step',
        "      return stack.step(observation)",
        '    File "mystack.py", line 7, in step',
        '      raise RuntimeError("lens cap on")',
        "  RuntimeError: lens cap on",
        f"  log: {path}",
    ]


def test_a_case_without_an_outcome_of_its_own_shows_the_log_of_its_last_attempt(tmp_path):
    log(tmp_path, "a", 1)
    path = log(tmp_path, "a", 2, "no traceback\n")
    case = failed("quarantined: killed\x1b[2J", outcome="unresolved", attempt=0, attempts=3)
    assert told(tmp_path, outcomes(a=case)) == [
        "a unresolved: quarantined: killed\\x1b[2J",
        f"  log: {path}",
    ]


def test_many_different_reasons_are_counted(tmp_path):
    cases = {f"c{i}": failed(f"reason {i}") for i in range(GROUPS_MAX + 2)}
    lines = told(tmp_path, outcomes(**cases))
    assert lines == [
        *(f"c{i} failed: reason {i}" for i in range(GROUPS_MAX)),
        "2 more cases failed for 2 other reasons",
    ]
    assert told(tmp_path, outcomes()) == []


def test_a_log_that_leads_elsewhere_is_not_read(tmp_path):
    outside = tmp_path / "outside.txt"
    outside.write_text(TRACEBACK)
    path = log(tmp_path / "run", "a")
    path.unlink()
    path.symlink_to(outside)
    assert told(tmp_path / "run", outcomes(a=failed("x"))) == ["a failed: x"]


def test_of_a_deep_traceback_the_last_lines_are_shown(tmp_path):
    deep = "Traceback (most recent call last):\n" + "  File x\n" * 50 + "RecursionError: deep\n"
    path = log(tmp_path, "a", text=deep)
    frames = ["    File x"] * (FRAME_LINES_MAX - 1) + ["  RecursionError: deep"]
    assert told(tmp_path, outcomes(a=failed("x"))) == [
        "a failed: x",
        *frames,
        f"  log: {path}",
    ]
    path.write_text("nothing")
    assert told(tmp_path, outcomes(a=failed("x"))) == ["a failed: x", f"  log: {path}"]
