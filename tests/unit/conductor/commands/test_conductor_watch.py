"""Watching: pace, lines, alarms, and when it ends."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

import pytest
from rich.console import Console
from unit.conductor.ops_bench import found, row

import conductor.commands.watch
from conductor.commands.pace import WINDOW_S, Pace, shown_time
from conductor.commands.tables import alarms, running_table, status_view
from conductor.commands.watch import Watched, watch
from twin.base.errors import InfrastructureError


class Source:
    """Answers with the given statuses in order; None: the conductor is away."""

    def __init__(self, *answers: dict[str, Any] | None) -> None:
        self.answers = list(answers)
        self.handlers: list[Callable[[], None]] = []

    def status(self) -> dict[str, Any]:
        answer = self.answers.pop(0)
        if answer is None:
            raise InfrastructureError("tcp/h:1: no conductor answers")
        return answer

    def on_event(self, handler: Callable[[], None]) -> None:
        self.handlers.append(handler)


@pytest.fixture(autouse=True)
def _hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.commands.watch, "POLL_S", 0.0)
    monkeypatch.setattr(conductor.commands.watch, "HASTE_S", 0.0)


def text(renderable: object) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(renderable)
    return console.file.getvalue()  # type: ignore[attr-defined,no-any-return]


def test_pace_needs_two_points() -> None:
    pace = Pace()
    assert pace.per_s is None
    pace.saw(0, 10.0)
    assert (pace.per_s, pace.eta_s(4)) == (None, None)
    pace.saw(3, 12.0)
    assert (pace.per_s, pace.eta_s(3)) == (1.5, 2.0)
    assert pace.eta_s(0) == 0.0


def test_pace_forgets_what_is_older_than_the_window() -> None:
    pace = Pace()
    pace.saw(0, 0.0)
    pace.saw(600, 10.0)
    pace.saw(600, 10.0 + WINDOW_S)
    assert pace.per_s == 0.0
    assert pace.eta_s(5) is None


def test_pace_starts_anew_with_another_conductor() -> None:
    pace = Pace()
    pace.saw(10, 0.0)
    pace.saw(2, 1.0)
    assert pace.per_s is None


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (None, "-"),
        (0.0, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (3599.4, "59 min 59 s"),
        (3600, "1 h 00 min"),
        (90_000, "25 h 00 min"),
    ],
)
def test_shown_time(seconds: float | None, shown: str) -> None:
    assert shown_time(seconds) == shown


def test_over_only_when_there_was_something() -> None:
    watched = Watched()
    assert not watched.over
    watched.saw(found(), 0.0)
    assert not watched.over
    watched.saw(found(alpha=row(left=1), beta=row(left=0)), 1.0)
    assert not watched.over
    watched.saw(found(alpha=row(left=0), beta=row(left=0)), 2.0)
    assert watched.over


def test_disagreement_is_an_alarm() -> None:
    status = found(alpha=row(disagreements=1), beta=row())
    assert ["alarm" in line and "'alpha'" in line for line in alarms(status)] == [True]
    assert "1 late attempt of" in text(status_view(status))
    status["storage_error"] = "no space left"
    assert alarms(status)[1] == "storage: no space left"


def test_the_table_shows_pace() -> None:
    watched = Watched()
    watched.saw(found(alpha=row(left=16)), 0.0)
    watched.saw(found(alpha=row(left=8)), 4.0)
    shown = text(status_view(watched.found, watched.paces))
    assert "2.00" in shown
    assert "4 s" in shown
    assert "cases/s" not in text(status_view(watched.found))


def test_lines_without_a_terminal_and_the_end() -> None:
    console = Console(file=io.StringIO(), width=20)
    source = Source(
        found(alpha=row(left=2)),
        found(alpha=row(left=2)),
        None,
        None,
        found(alpha=row(left=0)),
    )
    assert watch(source, console, as_json=False) == 0
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) == 3, lines
    assert lines[0].startswith("alpha: 14 of 16 cases ended")
    assert lines[1] == "tcp/h:1: no conductor answers; still watching"
    assert lines[2].startswith("alpha: 16 of 16 cases ended")
    assert len(source.handlers) == 1


def test_json_is_one_object_per_change(capsys: pytest.CaptureFixture[str]) -> None:
    source = Source(found(alpha=row(left=2)), found(alpha=row(left=0)))
    assert watch(source, Console(file=io.StringIO()), as_json=True) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["left"] for line in lines] == [2, 0]


def test_nobody_at_the_start_is_an_error() -> None:
    with pytest.raises(InfrastructureError):
        watch(Source(None), Console(file=io.StringIO()), as_json=False)


def test_a_terminal_gets_the_table() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=160)
    source = Source(found(alpha=row(left=2)), None, found(alpha=row(left=0)))
    assert watch(source, console, as_json=False) == 0
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert "alpha" in shown
    assert "still watching" in shown


def test_running_cases_are_a_table(capsys):
    row = {"campaign": "alpha", "case": "repeat_1", "worker": "w1", "host": "n1", "attempt": 2}
    running_table([{**row, "tick": 40, "for_s": 3.4, "by_hand": "paused"}])
    said = capsys.readouterr().out
    for word in ("alpha", "repeat_1", "w1", "n1", "2", "40", "3 s", "paused"):
        assert word in said
    running_table([])
    assert capsys.readouterr().out == "no case runs now\n"
