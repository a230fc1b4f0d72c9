"""twin bench all: figures of every bench, the history, what fell, and the page."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import msgspec
import pytest
import typer

from twin.base.errors import UsageError
from twin.bench import drive, storyboard
from twin.bench.campaign import Request, SlotsRow
from twin.bench.campaign import as_json as campaign_json
from twin.bench.radar import RadarFigures
from twin.bench.trends.benches import BENCHES, Figure, Outcome, in_a_process, measure, read_figures
from twin.bench.trends.command import bench_all, chosen
from twin.bench.trends.history import (
    HistoryRow,
    append_history,
    machine_of,
    read_history,
    trends,
)
from twin.bench.trends.page import plot, write_page

NAMED = {bench.name: bench for bench in BENCHES}
HERE = "cpu:x86_64+avx2+fma, A processor, 2 cores"


def row(value: float, target: str = "lidar", **changed) -> HistoryRow:
    at = {"at": "2026-11-26T08:00:00Z", "machine": HERE, "software": "0" * 12}
    return HistoryRow(
        **(at | {"target": target, "value": value, "unit": "rays/s", "better": "more"} | changed)
    )


def test_figures_are_those_that_the_benches_print():
    found = drive.DriveFigures(900.0, 800.0, 300.0, None)
    assert read_figures(NAMED["drive"], json.dumps(drive.as_json(found))).figures == [
        Figure("drive plane, shared memory", 900.0, "ticks/s", "more"),
        Figure("drive plane, TCP", 800.0, "ticks/s", "more"),
        Figure("drive plane, payload over TCP", 300.0, "ticks/s", "more"),
    ]
    steps = storyboard.StoryboardFigures("cpu", 1, 16, 0.21, None)
    assert read_figures(NAMED["storyboard"], json.dumps(storyboard.as_json(steps))).figures == [
        Figure("storyboard step", 0.21, "ms", "less")
    ]
    radar = RadarFigures("cpu", "long_range", 1, 92.5, 30.0, "0" * 64)
    assert read_figures(NAMED["radar"], json.dumps(asdict(radar))).figures == [
        Figure("radar", 92.5, "measurements/s", "more")
    ]


def test_figures_of_a_campaign_are_those_of_its_last_number_of_slots(tmp_path):
    slots = SlotsRow(
        slots=4,
        cases=8,
        fingerprint="f",
        transport="memory",
        everything=True,
        unread=["lidar.roof"],
        wall_s=20.0,
        loop_s=10.0,
        sim_s=100.0,
        ticks=500,
        frames=400,
        slot_use=0.75,
        shares={},
        laps_s={},
        quarters=[],
        round_trip_p50_ms=1.0,
        round_trip_p99_ms=2.0,
        gpu_percent=None,
        gpu_memory_bytes=None,
    )
    request = Request("aeb-demo", "cpu", tmp_path, None, "1")
    printed = json.dumps(campaign_json(request, [slots, slots]))
    assert read_figures(NAMED["campaign"], printed).figures == [
        Figure("campaign aeb-demo", 200.0, "ms/sim s", "less"),
        Figure("campaign aeb-demo, loop", 100.0, "ms/sim s", "less"),
        Figure("campaign aeb-demo, slot use", 75.0, "%", "more"),
    ]
    read = replace(slots, everything=False, wall_s=15.0, loop_s=7.0)
    printed = json.dumps(campaign_json(request, [slots, slots, read]))
    assert read_figures(NAMED["campaign"], printed).figures == [
        Figure("campaign aeb-demo", 200.0, "ms/sim s", "less"),
        Figure("campaign aeb-demo, as read", 150.0, "ms/sim s", "less"),
        Figure("campaign aeb-demo, loop", 100.0, "ms/sim s", "less"),
        Figure("campaign aeb-demo, slot use", 75.0, "%", "more"),
    ]


@pytest.mark.parametrize(
    "printed",
    [
        "",
        "[]",
        "{}",
        '{"frames_per_s": "many"}',
        '{"frames_per_s": null}',
        '{"frames_per_s": 0}',
        '{"frames_per_s": -1}',
        "Traceback",
    ],
)
def test_what_is_no_figure_is_a_failure(printed):
    outcome = read_figures(NAMED["radar"], printed)
    assert not outcome.figures
    assert outcome.failure
    assert "\n" not in outcome.failure


def test_a_bench_that_fails_keeps_no_other_from_running():
    ran = []

    def run(words):
        ran.append(words[2])
        return '{"frames_per_s": 5.0}' if words[2] == "radar" else Outcome([], "no")

    found = measure([NAMED["vehicle"], NAMED["radar"]], "cpu", run)
    assert ran == ["vehicle", "radar"]
    assert found["vehicle"] == Outcome([], "no")
    assert found["radar"].figures == [Figure("radar", 5.0, "measurements/s", "more")]


def test_a_command_that_ends_badly_says_why():
    outcome = in_a_process(["twin", "bench", "radar", "--device", "cuda:77"])
    assert isinstance(outcome, Outcome)
    assert outcome.failure.startswith("ended with exit code 2: ")
    assert "cuda:77" in outcome.failure


@pytest.mark.parametrize(
    ("better", "value", "fell"),
    [
        ("more", 100.0, False),
        ("more", 90.1, False),
        ("more", 90.0, True),
        ("more", 50.0, True),
        ("less", 111.0, False),
        ("less", 112.0, True),
        ("less", 50.0, False),
    ],
)
def test_a_tenth_worse_than_the_median_has_fallen(better, value, fell):
    earlier = [row(v, better=better) for v in (100.0, 1.0, 100.0, 1000.0, 100.0)]
    (found,) = trends([*earlier, row(value, better=better)], HERE)
    assert found.median == 100.0
    assert found.fell is fell


def test_only_the_same_machines_and_targets_are_compared():
    rows = [row(100.0), row(10.0, machine="cuda:NVIDIA H200, B, 16 cores"), row(7.0, "radar")]
    (lidar, radar) = trends([*rows, row(95.0)], HERE)
    assert (lidar.row.value, [r.value for r in lidar.earlier]) == (95.0, [100.0])
    assert (radar.row.value, radar.earlier) == (7.0, [])
    assert radar.change is None
    assert not radar.fell


def test_the_median_is_of_the_latest_rows():
    (found,) = trends([*(row(1000.0) for _ in range(30)), *(row(10.0) for _ in range(20)),
                       row(10.0)], HERE)  # fmt: skip
    assert found.median == 10.0


def test_a_history_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "new" / "benches.jsonl"
    assert read_history(path) == []
    append_history(path, [row(1.0), row(2.0, "radar", label="commit abc")])
    append_history(path, [row(3.0)])
    assert read_history(path) == [row(1.0), row(2.0, "radar", label="commit abc"), row(3.0)]


@pytest.mark.parametrize(
    "line",
    [b"x", b"{}", b'{"at":1}', msgspec.json.encode(row(1.0)).replace(b"1.0", b"-1.0"), b"\xff"],
)
def test_a_damaged_line_is_named(tmp_path, line):
    path = tmp_path / "h.jsonl"
    append_history(path, [row(1.0)])
    path.write_bytes(path.read_bytes() + line + b"\n")
    with pytest.raises(UsageError, match=r"h\.jsonl: line 2 is no row of a history: "):
        read_history(path)


def test_nothing_is_measured_for_a_history_that_cannot_be_used(tmp_path):
    ran = []
    with pytest.raises(UsageError, match=r"--history .*: .*directory"):
        bench_all(
            "cpu", "radar", tmp_path, tmp_path / "p.html", "", as_json=False, check=False,
            run=lambda words: ran.append(words) or "",
        )  # fmt: skip
    with pytest.raises(UsageError, match="--label: 3 characters given"):
        bench_all(
            "cpu", "", tmp_path / "h", tmp_path / "p.html", "a\nb", as_json=False, check=False,
            run=lambda words: ran.append(words) or "",
        )  # fmt: skip
    assert not ran


def test_some_benches_may_be_chosen():
    assert [bench.name for bench in chosen("radar,vehicle")] == ["vehicle", "radar"]
    assert chosen("") == list(BENCHES)
    with pytest.raises(UsageError, match="--only: no bench 'raddar'; did you mean 'radar'"):
        chosen("raddar")


def test_a_fall_ends_with_1_only_if_it_is_asked_for(tmp_path, capsys):
    history, page = tmp_path / "h.jsonl", tmp_path / "p.html"

    def run(rate: float, *, check: bool) -> dict:
        bench_all(
            "cpu", "radar", history, page, "", as_json=True, check=check,
            run=lambda _words: json.dumps({"frames_per_s": rate}),
        )  # fmt: skip
        return json.loads(capsys.readouterr().out)

    (first,) = run(100.0, check=True)["targets"]
    assert (first["median"], first["fell"]) == (None, False)
    assert first["machine"] == machine_of("cpu")
    (second,) = run(80.0, check=False)["targets"]
    assert (second["median"], second["fell"], second["earlier"]) == (100.0, True, 1)
    with pytest.raises(typer.Exit) as ended:
        run(70.0, check=True)
    assert ended.value.exit_code == 1
    said = capsys.readouterr()
    assert "fell by 10% or more: radar" in said.err
    assert len(read_history(history)) == 3, "what was measured stands there all the same"
    assert 'class="fell"' in page.read_text()


def test_a_bench_without_figures_ends_with_1(tmp_path, capsys):
    with pytest.raises(typer.Exit):
        bench_all(
            "cpu", "radar", tmp_path / "h", tmp_path / "p", "", as_json=True, check=False,
            run=lambda _words: Outcome([], "it broke"),
        )  # fmt: skip
    said = capsys.readouterr()
    assert json.loads(said.out)["failed"] == {"radar": "it broke"}
    assert "bench radar: it broke" in said.err


def test_the_page_escapes_and_is_the_same_every_time(tmp_path):
    odd = "<script>alert(1)</script> $x$"
    found = trends([row(100.0, odd), row(50.0, odd, label="<b>"), row(5.0, "radar")], HERE)
    for name in ("a.html", "b.html"):
        write_page(tmp_path / name, "<i>machine</i>", found)
    page = (tmp_path / "a.html").read_text()
    assert page == (tmp_path / "b.html").read_text()
    assert "<script>" not in page
    assert "<b>" not in page
    assert "<i>" not in page
    assert page.count("<svg") == 2
    assert "1 of 2 targets fell by 10%" in page


def test_a_plot_has_a_point_per_run():
    (found,) = trends([row(float(v)) for v in (100, 101, 102, 60)], HERE)
    assert str(plot(found)).count("<use ") >= 4
