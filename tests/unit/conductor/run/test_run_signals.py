"""conductor.run.command: a signal that comes at any moment of a run stops it."""

from __future__ import annotations

import signal
import sys
import threading

import pytest

import conductor.run.command
from conductor.run.command import RunOptions, local_workers, run_campaign
from conductor.run.places import WorkersOption
from conductor.serve.shell import Conductor
from schemas.plan import parse_plan

LINES_MAX = 500
"""More than a run of an ended campaign executes."""


class SignalAtLine:
    """Sends SIGINT right before line ``at`` (from 0) that a run executes once it is set up."""

    def __init__(self, at: int) -> None:
        self.at = at
        self.lines = 0
        self.inside = False

    def __call__(self, frame, event, _argument):
        """For sys.settrace."""
        code = frame.f_code
        if code.co_filename != conductor.run.command.__file__:
            return None
        if event == "call" and code.co_name == "_execute":
            self.inside = True
        elif event == "return" and code.co_name == "_execute":
            self.inside = False
        elif event == "line" and self.inside:
            self.lines += 1
            if self.lines == self.at + 1:
                signal.raise_signal(signal.SIGINT)
        return self


@pytest.fixture
def ended(tmp_path, monkeypatch):
    """A campaign that has ended, and its options; conductors that still serve are stopped."""
    conductors: list[Conductor] = []

    class Remembered(Conductor):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            conductors.append(self)

    plan, mistakes = parse_plan(
        {"campaign": "alpha", "simulator": "noop", "matrix": {"repeat": [0]}}
    )
    assert plan is not None, mistakes
    options = RunOptions(out=tmp_path / "run", workers=WorkersOption(count=1))
    workers = local_workers(plan, options)
    try:
        assert run_campaign(plan, options, workers) == 0
    finally:
        workers.stop()
    monkeypatch.setattr(conductor.run.command, "Conductor", Remembered)
    yield plan, options
    for found in conductors:
        found.stop()


@pytest.mark.slow
def test_a_signal_before_any_line_leaves_no_conductor_serving(ended):
    plan, options = ended
    codes = []
    for at in range(LINES_MAX):
        at_line = SignalAtLine(at)
        workers = local_workers(plan, options)
        sys.settrace(at_line)
        try:
            codes.append(run_campaign(plan, options, workers))
        finally:
            sys.settrace(None)
            workers.stop()
        serving = [thread for thread in threading.enumerate() if thread.name == "conductor"]
        assert not serving, f"still serving after a signal before line {at} of the run"
        if at_line.lines <= at:
            break
    assert codes[-1] == 0, "the last run had no signal"
    assert set(codes[:-1]) == {130}
    assert len(codes) > 20
