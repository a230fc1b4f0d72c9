"""The bench: what counts as missed, and that its synthetic cases are what it says."""

import json
import os
import threading

import pytest
from waiting import PATIENCE_S

from schemas.wire import topics
from schemas.wire.codec import ATTACHMENT_BYTES_MAX, decode
from schemas.wire.view import Thumbnail
from twin.base.errors import UsageError
from twin.fabric.zenoh_bus import open_bus
from viewer.bench import running
from viewer.bench.command import bench, misses
from viewer.bench.compare import (
    MODES,
    SHARE_MIN,
    CampaignRun,
    CampaignWindow,
    CourseSample,
    compare,
    lines,
    window,
)
from viewer.bench.course import CampaignCourse, part_of
from viewer.bench.running import BenchOptions


def viewer(**changes):
    return {"viewer": {"cpu_share": 0.25, "memory_last_mb": 600.0, **changes}}


def console(**changes):
    return {"console": {"cpu_share": 0.15, "pictures_per_s": 1.0, "lag_max_s": 2.0, **changes}}


def table(**changes):
    return {"table": {"cases": 10_240, "first_cpu_s": 1.5, "memory_mb": 400.0, **changes}}


def runs(mode, *walls, cpu=None, **changes):
    """Runs of 10 cases that took so many seconds of wall time, and of one core unless said."""
    recorded = (4.0,) * 10 if mode == "record" else ()
    values = {"fingerprint": "same", "recordings_mb": recorded, **changes}
    return [
        CampaignRun(10, CampaignWindow(10, wall, wall if cpu is None else cpu), **values)
        for wall in walls
    ]


def simulation(**changes):
    found = {mode: runs(mode, 100.0, 100.0, 140.0) for mode in MODES}
    return {"simulation": compare(found | changes)}


def test_exactly_at_the_targets_nothing_is_missed():
    slower = {mode: runs(mode, *[100 / least] * 2) for mode, least in SHARE_MIN.items()}
    assert misses({**viewer(), **console(), **table(), **simulation(**slower)}) == []
    assert misses(simulation(record=runs("record", 100.0, recordings_mb=(12.0,) * 10))) == []


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (viewer(cpu_share=0.26), "26% of a core"),
        (viewer(memory_last_mb=600.1), "600.1 MB"),
        (console(cpu_share=0.16), "console: 16% of a core"),
        (table(first_cpu_s=1.6), "its table in 1.6 s"),
        (table(memory_mb=401.0), "10240 cases take 401.0 MB"),
        (console(lag_max_s=2.1), "pictures lag 2.1 s"),
        (console(lag_max_s=None), "nobody knows how far"),
        (console(pictures_per_s=0.0), "was given no picture"),
        (simulation(console=runs("console", 103.0, 103.0, cpu=100)), "of the console: 97.1%"),
        (
            simulation(live=runs("live", 106.0, 106.0, cpu=100)),
            "a viewer: 94.3% of the cases per minute",
        ),
        (simulation(frozen=runs("frozen", 101.2, 101.2, cpu=100)), "frozen viewer: 98.8%"),
        (simulation(record=runs("record", 112.0, 112.0, cpu=100)), "recorded: 89.3%"),
        (simulation(record=runs("record", 100.0, recordings_mb=(12.1,) * 10)), "12.1 MB a case"),
        (simulation(record=runs("record", 100.0, recordings_mb=(1.0,) * 9)), "9 recordings of 10"),
        (simulation(live=runs("live", 100.0, fingerprint="other")), "differ"),
    ],
)
def test_each_target_can_be_missed(found, words):
    [line] = misses(found)
    assert words in line


def test_what_the_machine_does_beside_is_not_held_against_viewers():
    noisy = runs("none", 100.0, 110.0, 150.0)
    assert misses(simulation(none=noisy, live=runs("live", 112.0, 112.0))) == []
    [by_rate] = misses(simulation(none=noisy, live=runs("live", 120.0, 120.0)))
    assert "83.3% of the cases per minute (noise 10.0%), 83.3% of those per processor" in by_rate
    assert misses(simulation(live=runs("live", 120.0, 150.0))) == [], "nor in their own runs"
    once = simulation(none=runs("none", 100.0), live=runs("live", 300.0))
    assert misses(once) == [], "one run says nothing"


def test_processor_time_tells_where_the_clock_cannot():
    """Other work doubles a run's wall time, and leaves its processor time as it is."""
    loud = [CampaignRun(10, CampaignWindow(10, wall, 40.0), "same") for wall in (100.0, 200.0)]
    dear = [
        CampaignRun(10, CampaignWindow(10, wall, 50.0), "same", (4.0,) * 10)
        for wall in (110.0, 220.0)
    ]
    [missed] = misses(simulation(none=loud, live=loud, frozen=loud, console=loud, record=dear))
    assert "recorded: 90.9% of the cases per minute (noise 100.0%), 80.0% of those" in missed


def test_what_noise_hides_is_told_and_no_miss():
    found = simulation(record=runs("record", 115.0, 130.0))
    assert misses(found) == []
    assert "recorded: at least 90% is not shown" in "\n".join(lines(found["simulation"]))
    shown = simulation(record=runs("record", 115.0, 130.0, cpu=100.0))
    assert "not shown" not in "\n".join(lines(shown["simulation"]))


def test_the_first_and_last_cases_are_left_out():
    samples = [CourseSample(0, 10.0, 0.0)]
    samples += [CourseSample(n, 30.0 + 2 * n, 50.0 + 4 * n) for n in range(1, 20)]
    samples.append(CourseSample(20, 100.0, 400.0))
    assert window(samples, 2) == CampaignWindow(14, 28.0, 56.0), "two of each slot, and one"
    assert window(samples, 1) == CampaignWindow(17, 34.0, 68.0)
    assert window(samples, 64) == CampaignWindow(10, 20.0, 40.0), "a quarter at each end, at most"
    parts = [
        CourseSample(
            n, 2.0 * n, 4.0 * n, {"stacks": 3.0 * n, **({"judge": n - 5.0} if n > 5 else {})}
        )
        for n in range(21)
    ]
    assert window(parts, 2).parts_s == {"stacks": 42.0, "judge": 13.0}
    at_once = [CourseSample(0, 1.0, 1.0), CourseSample(8, 5.0, 9.0)]
    assert window(at_once, 4) == CampaignWindow(8, 4.0, 8.0)
    with pytest.raises(UsageError, match="at least 4"):
        window(samples[:2], 1)


def test_a_campaign_is_looked_at_as_it_goes(tmp_path):
    course = CampaignCourse(os.getpid(), tmp_path)
    assert not course.look(), "nothing there yet"
    timeline = tmp_path / "timeline.jsonl"
    leased = [json.dumps({"event": "leased", "worker": w}) for w in ("a", "b")]
    timeline.write_text("\n".join(leased) + '\n{"event":"comm')
    assert course.look()
    assert not course.look(), "a torn line waits for its rest"
    with timeline.open("a") as file:
        file.write('itted","worker":"a"}\n')
    assert course.look()
    assert [sample.cases for sample in course.samples] == [0, 1]
    assert course.workers == 2
    assert 0 < course.samples[0].cpu_s <= course.samples[1].cpu_s
    assert all(sum(s.parts_s.values()) == s.cpu_s for s in course.samples)


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("/v/bin/python -m conductor run a.yaml --out o", "conductor"),
        ("python3 -m twin.fabric.front.process", "front"),
        ("python3 -m twin worker - {}", "workers"),
        ("python3 -m twin sim cpu", "simulators"),
        ("python3 -m twin judge --claims", "judge"),
        ("bwrap --ro-bind -m x -- python3 -m devkit host --connect -", "stacks"),
        ("python3 -m twin bench", "others"),
        ("python3 -m", "others"),
        ("sh -c true", "others"),
        ("", "others"),
    ],
)
def test_processes_are_told_apart_by_their_command_lines(line, part):
    assert part_of(line.split()) == part


def test_what_people_read():
    told = "\n".join(lines(simulation(live=runs("live", 104.0, 125.0))["simulation"]))
    assert "with nobody: 6.0 cases/min (4.286 to 6.0), 10.0 processor seconds per case" in told
    assert "with a viewer: 5.769 cases/min (4.8 to 5.769)" in told
    assert "96.2% of the cases per minute (noise 20.2%), 96.2% of those per processor" in told
    assert "not shown" not in told
    assert "30 recordings, 4.0 MB each" in told
    assert "results the same" in told


def test_too_many_in_full_is_a_mistake():
    with pytest.raises(UsageError, match="at most 8"):
        bench(BenchOptions(cases=4, focus=5), as_json=True, check=False)


def test_every_synthetic_case_is_sent():
    seen, all_seen = set(), threading.Event()

    def receive(sample):
        seen.add(decode(sample.attachment, Thumbnail, ATTACHMENT_BYTES_MAX).case)
        if len(seen) == 4:
            all_seen.set()

    with running.source(4) as endpoint:
        bus = open_bus("client", connect=[endpoint])
        bus.subscribe(topics.VIEW_THUMBNAIL.key.format(campaign="*", case="*"), receive)
        assert all_seen.wait(PATIENCE_S)
        bus.close()
    assert seen == {f"case-{index:03d}" for index in range(4)}


def test_synthetic_cases_are_measured(capsys, monkeypatch):
    monkeypatch.setattr("viewer.bench.command.WARM_UP_S", 0.5)
    options = BenchOptions(cases=4, focus=1, console=4, ended=200, seconds=0.5, rounds=0)
    assert bench(options, as_json=True, check=False) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["console"]["cases"] == 4
    assert figures["console"]["memory_mb"] > 20
    assert figures["console"].keys() >= {"lag_max_s", "lag_median_s"}
    table = figures["table"]
    assert table["cases"] >= 200
    assert table["first_cpu_s"] > 0
    assert table["again_s"] > 0
    assert table["line_kb"] > 1
    found = figures["viewer"]
    assert found["cases"] == 4
    assert found["in_full"] == 1
    assert found["cpu_share"] >= 0
    assert found["memory_last_mb"] > 20
    assert {"received", "overwritten", "logged", "skipped"} <= found.keys()
