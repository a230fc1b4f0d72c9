"""Leases over wall time, and the pace that follows from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.records.outcomes import encode_outcomes
from conductor.records.timeline import FILE_NAME, TimelineEvent
from conductor.report import make_report, tables_of
from conductor.report.pages.content import read_content
from conductor.report.plots.leases_figure import SPANS_MAX, lanes_of, leases_figure
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.leases import Leases, leases_of, read_leases
from twin.base.errors import UsageError

replace = msgspec.structs.replace


def event(at_s: float, what: str, case: str, token: int = 0, worker: str = "w1") -> TimelineEvent:
    return TimelineEvent(
        at_s=1e9 + at_s, event=what, case=case, token=token, worker=worker, attempt=1
    )


def told(leases: Leases) -> list[tuple[str, str, float, float, str]]:
    return [(s.case, s.worker, s.start_s, s.end_s, s.how) for s in leases.spans]


def write_timeline(folder: Path, *events: TimelineEvent, tail: bytes = b"") -> None:
    lines = b"".join(msgspec.json.encode(each) + b"\n" for each in events)
    (folder / FILE_NAME).write_bytes(lines + tail)


def one_after_the_other(folder: Path, seconds: float = 2.0) -> None:
    """Every case of the folder in a lease of its own."""
    events = []
    for number, row in enumerate(open_dossier(folder).rows):
        start = number * seconds
        events.append(event(start, "leased", row.case.id, number + 1))
        events.append(event(start + seconds, "committed", row.case.id, number + 1))
    write_timeline(folder, *events)


def test_every_end_of_a_lease() -> None:
    leases = leases_of(
        [
            event(0, "leased", "a", 1),
            event(0, "leased", "b", 2),
            event(2, "crash", "b", 2),
            event(3, "leased", "b", 3, "w2"),
            event(4, "leased", "a", 4, "w2"),
            event(5, "committed", "a", 4, "w2"),
            event(6, "late", "a", 1),
            event(7, "leased", "c", 5),
            event(8, "case_ended", "b"),
            event(9, "walltime", "z", 77),
        ]
    )
    assert told(leases) == [
        ("a", "w1", 0, 5, "superseded"),
        ("b", "w1", 0, 2, "crash"),
        ("b", "w2", 3, 8, "case_ended"),
        ("a", "w2", 4, 5, "committed"),
        ("c", "w1", 7, 9, "open"),
    ]
    assert leases.commits_s == [5]
    assert (leases.most, leases.busy_s) == (3, 9)
    assert leases.workers == ["w1", "w2"]


def test_a_pause_between_two_starts_does_not_count() -> None:
    leases = leases_of(
        [
            event(0, "leased", "a", 1),
            event(10, "committed", "a", 1),
            event(1000, "leased", "b", 2),
            event(1010, "committed", "b", 2),
        ]
    )
    assert (leases.busy_s, leases.commits_s, leases.most) == (20, [10, 1010], 1)


def test_a_lease_over_a_killed_conductor_ends_where_it_was_last_known() -> None:
    leases = leases_of(
        [
            event(0, "leased", "a", 1),
            event(0, "leased", "b", 2),
            event(0, "leased", "d", 3),
            event(20, "committed", "d", 3),
            event(3620, "started", ""),
            event(3625, "lost", "a", 1),
            event(3626, "leased", "a", 4),
            event(3630, "started", ""),
            event(3636, "committed", "a", 4),
        ]
    )
    assert told(leases) == [
        ("a", "w1", 0, 20, "lost"),
        ("b", "w1", 0, 20, "open"),
        ("d", "w1", 0, 20, "committed"),
        ("a", "w1", 3626, 3636, "committed"),
    ]
    assert leases.busy_s == 30


def test_a_clock_that_was_set_back_makes_no_negative_lease() -> None:
    leases = leases_of([event(10, "leased", "a", 1), event(4, "committed", "a", 1)])
    assert told(leases) == [("a", "w1", 0, 0, "committed")]


def test_without_a_file_or_with_damaged_lines(tmp_path: Path) -> None:
    assert told(read_leases(tmp_path)) == []
    write_timeline(tmp_path, event(0, "leased", "a", 1), tail=b'garbage\n{"at_s": 1e9, "ev')
    assert [span.how for span in read_leases(tmp_path).spans] == ["open"]
    assert leases_of([]).commits_s == []


def test_a_worker_has_as_many_lanes_as_leases_at_once() -> None:
    leases = leases_of(
        [
            event(0, "leased", "a", 1),
            event(0, "leased", "b", 2),
            event(0, "leased", "c", 3, "w2"),
            event(3, "committed", "b", 2),
            event(3, "leased", "d", 4),
            event(9, "committed", "a", 1),
        ]
    )
    lanes, places = lanes_of(leases.spans)
    assert lanes == [("w1", 0), ("w1", 1), ("w2", 0)]
    by_case = dict(zip([s.case for s in leases.spans], places, strict=True))
    assert by_case["d"] == by_case["b"], "it takes the slot that was free"
    assert len({by_case["a"], by_case["b"], by_case["c"]}) == 3


def test_a_huge_timeline_is_drawn_in_part(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    events = [event(n, w, f"c{n}", n + 1) for n in range(SPANS_MAX + 5) for w in ("leased", "lost")]
    figure = leases_figure(open_dossier(tmp_path), leases_of(events))
    assert figure is not None
    drawn = sum(x is None for trace in figure["data"][:-1] for x in trace["x"])
    assert drawn == SPANS_MAX


def speed(folder: Path, serial: Path | None = None) -> dict[str, Any]:
    found: dict[str, Any] = tables_of(read_content(open_dossier(folder), serial=serial))["speed"]
    return found


def test_the_speed_up_is_measured_or_missing(tmp_path: Path) -> None:
    run, serial = tmp_path / "run", tmp_path / "serial"
    for folder in (run, serial):
        make_campaign(folder)
    assert speed(run)["speed_up"] is None
    assert speed(run)["run"]["wall_s"] is None
    cases = [row.case.id for row in open_dossier(run).rows]
    write_timeline(
        run,
        *(event(0, "leased", case, n + 1, f"w{n % 2}") for n, case in enumerate(cases)),
        *(event(4, "committed", case, n + 1) for n, case in enumerate(cases)),
    )
    found = speed(run)
    assert (found["run"]["wall_s"], found["run"]["at_once"], found["run"]["workers"]) == (4, 8, 2)
    assert found["speed_up"] is None
    assert "--serial" in found["missing"]
    one_after_the_other(serial)
    found = speed(run, serial)
    assert (found["speed_up"], found["efficiency"], found["missing"]) == (4.0, 0.5, None)
    row = open_dossier(run).rows[0]
    rates = found["run"]
    assert rates["real_time"] == pytest.approx(row.scalar("sim_time_s") / 1.5, rel=0.3)
    total = sum(row.scalar("ticks") for row in open_dossier(run).rows)
    assert rates["net_hz"] == total / 4
    alone = speed(serial)
    assert (alone["speed_up"], alone["missing"]) == (1.0, None)
    page = make_report(run, serial=serial, plots=False).page.read_text()
    assert "4.00 x" in page
    assert "Beside <code>serial</code>" in page


def test_an_unfinished_run_has_no_speed_up(tmp_path: Path) -> None:
    run, serial = tmp_path / "run", tmp_path / "serial"
    make_campaign(serial)
    one_after_the_other(serial)
    first = open_dossier(serial).rows[0].case.id

    def begun(case: Any, end: Any) -> Any:
        return end if case.id == first else msgspec.convert({"outcome": ""}, type(end))

    make_campaign(run, change=begun)
    write_timeline(run, event(0, "leased", first, 1), event(1, "committed", first, 1))
    found = speed(run, serial)
    assert found["speed_up"] is found["efficiency"] is None
    assert found["missing"] == "this run: 7 of 8 cases have not ended"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"device_classes": ["cuda:sm_90"]}, "ran on cuda:sm_90, this on cpu:avx2"),
        ({"machines": ["cuda:sm_90"]}, "ran on cuda:sm_90, this on cpu:avx2"),  # same results
        ({"software": "6" * 64}, "with software 666666666666, this with 555555555555"),
    ],
)
def test_a_serial_run_of_something_else_is_refused(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    run, serial = tmp_path / "run", tmp_path / "serial"
    make_campaign(run)
    _, outcomes = make_campaign(serial)
    (serial / "outcomes.json").write_bytes(encode_outcomes(replace(outcomes, **changes)))
    one_after_the_other(serial)
    with pytest.raises(UsageError, match=said):
        speed(run, serial)


@pytest.mark.parametrize("why", ["another campaign", "at once", "not complete", "no campaign"])
def test_a_serial_run_that_is_none_is_refused(tmp_path: Path, why: str) -> None:
    run, serial = tmp_path / "run", tmp_path / "serial"
    make_campaign(run)

    def unfinished(case, end):
        return msgspec.convert({"outcome": ""}, type(end)) if why == "not complete" else end

    if why != "no campaign":
        make_campaign(serial, campaign_data(seed=8 if why == "another campaign" else 7), unfinished)
        one_after_the_other(serial)
    if why == "at once":
        ids = [row.case.id for row in open_dossier(serial).rows]
        leased = [event(0, "leased", case, 1) for case in ids[:3]]
        write_timeline(serial, *leased, event(5, "committed", ids[0], 1))
    messages = {"another campaign": "run the same campaign", "at once": "up to 3 cases at once"}
    with pytest.raises(UsageError, match=messages.get(why, "complete|no outcomes.json")) as caught:
        make_report(run, serial=serial, plots=False)
    assert "\n" not in str(caught.value)
    assert not (run / "report.html").exists()
