"""What stacks print, log and raise: in the log of every attempt, and on the terminal."""

import json
import re
from pathlib import Path

import pytest
from foreign_campaigns import CLIENT, campaign, python
from processes import interrupt, outcomes, wait_for

STACK = '''
import logging, os, subprocess, sys, threading
from devkit.stack import Stack
from schemas.messages import BOX_COLUMNS, Command

DISTANCE = BOX_COLUMNS.index("distance_m")
print("module loads")


class Talking(Stack):
    """Prints in every way, and does what ``fault`` says ``at`` a place in the case named."""

    def __init__(self, slots, *, fault="", at="step", case=""):
        super().__init__(slots)
        self.fault, self.at, self.case = fault, at, case
        self.names, self.braking = [""] * slots, [False] * slots
        print("constructed")
        self.go("init", case)

    def go(self, place, case):
        if place != self.at or self.case not in ("", case):
            return
        if self.fault == "raise":
            raise RuntimeError("lens cap on")
        if self.fault == "exit":
            sys.exit(7)
        if self.fault == "kill":
            os.kill(os.getpid(), 9)
        if self.fault == "flood":
            print("flood begins")
            for _ in range(200):
                os.write(1, b"x" * 999_999 + b"\\n")
            print("flood ends")
        if self.fault == "hang":
            print("hangs", flush=True)
            threading.Event().wait()

    def reset(self, slot, episode):
        self.names[slot], self.braking[slot] = episode.case, False
        print("printed by", episode.case, end=".", flush=False)
        logging.warning("logged by %s", episode.case)
        subprocess.run(["echo", "child of", episode.case])
        thread = threading.Thread(target=print, args=("thread of", episode.case))
        thread.start()
        thread.join()
        self.go("reset", episode.case)

    def step(self, observation):
        return [self.drive(slot, observation) for slot in observation.active_slots()]

    def drive(self, slot, observation):
        if observation.tick[slot] == 3:
            self.go("step", self.names[slot])
        token, tick = int(observation.token[slot]), int(observation.tick[slot])
        boxes = observation.boxes(slot)
        if boxes is not None:
            self.braking[slot] |= bool((boxes[:, DISTANCE] < 18.0).any())
        braking = self.braking[slot]
        throttle = 0.0 if braking else 0.3
        if self.fault in ("nan", "2.5") and tick == 3:
            throttle = float(self.fault)
        return Command(slot, token, tick, throttle, float(braking), 0.0, braking)
'''

WEATHERS = ["clear", "cloudy"]

SCENARIO = {"ego_start_m": 24, "ego_speed_mps": 7, "duration_s": 6, "standstill_s": 0.5}
"""Long enough to come to rest before the obstacle: a pass."""


@pytest.fixture
def run(marked, tmp_path, monkeypatch):
    """Runs the talking stack; what came of it, and the campaign's folder."""
    (tmp_path / "talking.py").write_text(STACK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    folder = tmp_path / "run"

    def run(*options, matrix=("clear",), placement="worker", command=None, **parameters):
        driver = {"stack": "talking:Talking", "placement": placement}
        autonomy = {**({"command": command} if command else driver), "parameters": parameters}
        path = campaign(
            tmp_path, "talks", autonomy, matrix={"weather": list(matrix)}, scenario=SCENARIO
        )
        done = marked.run(
            *("conductor", "run", str(path), "--workers", "1", "--out", str(folder)), *options
        )
        return done, folder

    return run


def log(folder, case, attempt=1):
    return (folder / f"cases/{case}/attempt-{attempt}/log.txt").read_text()


@pytest.mark.parametrize("placement", ["worker", "inline"])
def test_what_a_stack_prints_is_in_the_log_of_a_case_that_passes(run, placement):
    done, folder = run(matrix=WEATHERS, placement=placement)
    assert done.returncode == 0, done.stderr
    first, second = (log(folder, case) for case in WEATHERS)
    assert "module loads\nconstructed\n" in first
    assert "module loads" not in second
    for case, text in zip(WEATHERS, (first, second), strict=True):
        for line in (f"printed by {case}.", f"logged by {case}", f"child of {case}"):
            assert line in text
        assert f"thread of {case}" in text
    assert "cloudy" not in first
    assert "verdict: pass" in first.partition("--- printed by the stack ---")[0]


@pytest.mark.parametrize("placement", ["worker", "inline"])
def test_cases_side_by_side_share_what_was_printed_and_say_so(run, placement):
    done, folder = run("--slots", "2", matrix=WEATHERS, placement=placement)
    assert done.returncode == 0, done.stderr
    texts = {case: log(folder, case) for case in WEATHERS}
    # Both start at once if one grant brought them; either may come first.
    assert any({"module loads", "constructed"} <= set(text.splitlines()) for text in texts.values())
    for case, other in (WEATHERS, WEATHERS[::-1]):
        text = texts[case]
        assert f"shared with cases that ran beside this one: {other} ---" in text
        assert f"child of {case}" in text
        assert f"child of {other}" in text


@pytest.mark.parametrize("placement", ["worker", "inline"])
@pytest.mark.parametrize("at", ["init", "reset", "step"])
def test_what_a_stack_raises_is_its_outcome_after_one_attempt(run, placement, at):
    done, folder = run(fault="raise", at=at, placement=placement)
    assert done.returncode == 1, done.stderr
    (case,) = outcomes(folder).values()
    assert (case["outcome"], case["attempts"], case["charges"]) == ("failed", 1, [])
    assert "RuntimeError: lens cap on" in case["reasons"][0]
    text = log(folder, "clear")
    assert "Traceback (most recent call last):" in text
    assert "RuntimeError: lens cap on" in text
    assert "constructed" in text
    assert "clear failed: " in done.stderr
    assert 'raise RuntimeError("lens cap on")' in done.stderr
    assert f"log: {folder / 'cases/clear/attempt-1/log.txt'}" in done.stderr
    assert case["manifest_sha256"]


def test_of_cases_side_by_side_the_one_that_raises_fails_alone_and_the_others_go_on(run):
    done, folder = run("--slots", "2", matrix=WEATHERS, fault="raise", case="cloudy")
    assert done.returncode == 1, done.stderr
    cases = outcomes(folder)
    assert {name: case["outcome"] for name, case in cases.items()} == {
        "clear": "verdict",
        "cloudy": "failed",
    }
    assert [cases[name]["attempts"] for name in WEATHERS] == [2, 2]
    assert all(case["charges"] == [] for case in cases.values())
    # What was printed in the first attempt is kept as well, of both.
    for case in WEATHERS:
        assert "RuntimeError: lens cap on" in log(folder, case, 1)
    assert "RuntimeError: lens cap on" in log(folder, "cloudy", 2)
    assert "RuntimeError" not in log(folder, "clear", 2)


def test_a_stack_that_cannot_be_loaded_fails_all_cases_at_once(run):
    done, folder = run("--slots", "2", matrix=WEATHERS, fault="raise", at="init")
    assert done.returncode == 1, done.stderr
    assert [case["attempts"] for case in outcomes(folder).values()] == [1, 1]
    assert "clear (and 1 more) failed: stack: talking:Talking: RuntimeError" in done.stderr
    for case in WEATHERS:
        assert "RuntimeError: lens cap on" in log(folder, case)


def test_a_flood_is_cut_in_the_middle_and_changes_nothing(run, marked, tmp_path):
    done, folder = run("--output", "json", matrix=WEATHERS, fault="flood")
    assert done.returncode == 0, done.stderr
    flooded = json.loads(done.stdout)["fingerprint"]
    for case in WEATHERS:
        text = log(folder, case)
        assert len(text) < 300_000
        assert "flood begins" in text
        assert text.rstrip().endswith("flood ends")
        (dropped,) = re.findall(r"--- ([\d,]+) bytes left out ---", text)
        assert int(dropped.replace(",", "")) > 199_000_000
    quiet = tmp_path / "quiet"
    path = campaign(
        tmp_path,
        "talks",
        {"stack": "talking:Talking"},
        matrix={"weather": WEATHERS},
        scenario=SCENARIO,
    )
    done = marked.run("conductor", "run", str(path), "--output", "json", "--out", str(quiet))
    assert json.loads(done.stdout)["fingerprint"] == flooded


@pytest.mark.parametrize(("fault", "said"), [("nan", "nan"), ("2.5", "2.5")])
def test_a_command_that_is_no_number_or_out_of_range_is_told_on_the_terminal(run, fault, said):
    done, folder = run(fault=fault)
    assert done.returncode == 1, done.stderr
    reason = f"command throttle is {said}, allowed: 0 to 1, at tick 3"
    assert f"clear failed: {reason}" in done.stderr
    assert f"log: {folder / 'cases/clear/attempt-1/log.txt'}" in done.stderr


@pytest.mark.parametrize(
    ("fault", "outcome", "code"), [("exit", "failed", 1), ("kill", "unresolved", 3)]
)
def test_who_leaves_has_failed_and_who_is_killed_is_tried_again(run, fault, outcome, code):
    done, folder = run(fault=fault)
    assert done.returncode == code, done.stderr
    (case,) = outcomes(folder).values()
    assert (case["outcome"], case["attempts"]) == (outcome, 1 if fault == "exit" else 3)
    for attempt in range(1, case["attempts"] + 1):
        assert "child of clear" in log(folder, "clear", attempt)


def test_a_script_of_its_own_that_raises_has_failed_with_its_last_line(run, tmp_path):
    script = tmp_path / "raising.py"
    answered = '            say("command", answer)\n            arrays'
    source = CLIENT.read_text()
    assert answered in source
    fault = '            print("tick", seq)\n            if head["tick"][0] == 3:\n'
    fault += '                raise ValueError("no lens")\n'
    script.write_text(source.replace(answered, fault.replace(", seq", "") + answered))
    done, folder = run(command=python(script))
    assert done.returncode == 1, done.stderr
    (case,) = outcomes(folder).values()
    assert (case["outcome"], case["attempts"]) == ("failed", 1)
    assert case["reasons"][0] == "stack exit code 1: ValueError: no lens, at tick 3"
    assert log(folder, "clear").count("tick\n") >= 4
    assert 'raise ValueError("no lens")' in done.stderr


def test_a_stack_that_hangs_has_said_so_when_the_run_is_stopped(marked, tmp_path, monkeypatch):
    (tmp_path / "talking.py").write_text(STACK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    autonomy = {"stack": "talking:Talking", "parameters": {"fault": "hang"}}
    path, folder = campaign(tmp_path, "hangs", autonomy), tmp_path / "run"
    child = marked.start("conductor", "run", str(path), "--workers", "1", "--out", str(folder))
    stack = marked.one("devkit", "host", "talking:Talking")
    wait_for(lambda: b"hangs" in said_by(stack.pid), "the stack's words")
    interrupt(child)
    assert child.wait() == 130
    assert "\nhangs\n" in log(folder, "clear")


def said_by(pid):
    """The log of a process, which has no name."""
    return Path(f"/proc/{pid}/fd/1").read_bytes()
