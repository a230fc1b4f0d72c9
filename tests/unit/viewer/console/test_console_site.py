"""What the console answers of finished campaigns: the same addresses, served or written."""

import json
import shlex

import numpy as np
import pytest
from unit.viewer.console.console_runs import CASES, a_run, ended, kpi, outcomes

from twin.base.errors import InfrastructureError, TwinError, UsageError
from viewer.console.pictures import picture_from
from viewer.console.run_folder import RunFolder, find_runs
from viewer.console.site import ConsoleSite


def site_of(folder):
    return ConsoleSite(find_runs(folder), keep=False)


def read(site, path):
    return json.loads(site.answer(path).data)


@pytest.fixture
def run(tmp_path):
    return a_run(tmp_path / "demo")


def test_the_list_and_a_campaign(run):
    (run / "timeline.jsonl").write_text(
        '{"at_s":100.0,"event":"leased","worker":"w1"}\n{"torn\n'
        '{"at_s":160.0,"event":"committed","worker":"w2"}\n'
    )
    (run / "manifest.json").write_text('{"fingerprint": "abc"}')
    site = site_of(run)
    (row,) = read(site, "runs.json")["runs"]
    assert (row["id"], row["state"], row["cases"], row["done"]) == ("demo", "finished", 4, 4)
    assert (row["started_s"], row["elapsed_s"], row["workers"]) == (100.0, 60.0, 2)
    assert row["per_minute"] == 4.0
    assert row["device_hours"] == pytest.approx(4 * 1.8 / 3600)
    assert row["eta_s"] is None
    about = read(site, "runs/demo/run.json")
    assert about["fingerprint"] == "abc"
    assert [axis["name"] for axis in about["axes"]] == ["model", "time_of_day", "weather"]
    assert about["links"] == {"report": None, "search": None, "rulebook": None}


def test_the_table_is_read_again_when_the_outcomes_change(run):
    site = site_of(run)
    first = read(site, "runs/demo/table.json")
    assert first["cases"] == list(CASES)
    assert read(site, "runs/demo/table.json") == first
    outcomes(run, {CASES[0]: ended("collision"), **{case: {} for case in CASES[1:]}}, False)
    second = read(site, "runs/demo/table.json")
    assert second["version"] != first["version"]
    assert second["columns"]["verdict"] == ["collision", None, None, None]
    assert second["columns"]["state"] == ["ended", "waiting", "waiting", "waiting"]


def test_a_case_page_says_null_where_nothing_was_recorded(run):
    site = site_of(run)
    page = read(site, f"runs/demo/cases/{CASES[0]}/case.json")
    assert page["moment"] == {"t": 0.05, "what": "closest"}
    assert page["film"]["frames"] == 3
    assert page["film"]["picture"] == [64, 36]
    assert page["links"]["recording"] == f"recording/demo/{CASES[0]}.rrd"
    assert page["links"]["in_full"] == f"view?run=demo&case={CASES[0]}#when=sim_time@+0.05s"
    after = page["neighbours"]["weather"]["after"]
    assert (after["case"], after["index"], after["state"]) == (CASES[1], 1, "ended")
    assert page["log"]["lines"] == [f"case {CASES[0]}", "all is well"]
    bare = read(site, f"runs/demo/cases/{CASES[3]}/case.json")
    assert bare["film"] is None
    assert bare["links"]["recording"] is None
    assert bare["links"]["in_full"] is None
    assert bare["moment"] == {"t": 0.05, "what": "closest"}, "of its rows"
    assert bare["events"] == [{"t": 0.05, "what": "warn", "detail": "AEB triggered"}]
    with pytest.raises(UsageError, match="not recorded"):
        site.answer(f"runs/demo/cases/{CASES[3]}/moment.webp")


def test_the_repeat_command_is_safe_in_a_shell_and_can_be_run_where_its_reader_is(tmp_path):
    run = a_run(tmp_path / "de mo; rm -rf x", recorded=())
    site = site_of(run)
    ((name, shown),) = site.runs.items()
    address = f"runs/{name}/cases/{CASES[0]}/case.json"
    start = ["conductor", "run", str(run / "campaign.yaml"), "--case", CASES[0]]
    assert shlex.split(read(site, address)["repeat"])[:5] == start
    shown.portable = True
    start[2] = "de mo; rm -rf x/campaign.yaml"
    assert shlex.split(read(site, address)["repeat"])[:5] == start
    shown.portable = False
    (run / "campaign.yaml").unlink()
    assert str(tmp_path) not in read(site, address)["repeat"], "there is no such file"


def test_text_of_a_stack_stays_text(run):
    log = run / "cases" / CASES[0] / "attempt-1" / "log.txt"
    log.write_bytes(
        b"<script>alert(1)</script>\x1b[2J\xff\n"
        b"Traceback (most recent call last):\n"
        b'  File "<img src=x onerror=alert(1)>", line 1\nValueError: \x00</script>\n'
    )
    (run / "outcomes.json").write_text(
        json.dumps(
            {
                "campaign": "demo",
                "complete": True,
                "cases": {
                    CASES[0]: ended("collision", reasons=["<b>\u001b[1m"], charges=["\n<i>"])
                },
            }
        )
    )
    page = read(site_of(run), f"runs/demo/cases/{CASES[0]}/case.json")
    assert page["log"]["lines"][0] == "<script>alert(1)</script>\\x1b[2J�"
    assert page["log"]["traceback"][-1] == "ValueError: \\x00</script>"
    assert page["reasons"] == ["<b>\\x1b[1m"]
    assert page["attempts"]["charges"] == ["\\n<i>"]


def test_a_long_log_is_cut_at_its_beginning(run):
    log = run / "cases" / CASES[0] / "attempt-1" / "log.txt"
    log.write_text("first\n" + "x" * 200_000 + "\nlast\n")
    page = read(site_of(run), f"runs/demo/cases/{CASES[0]}/case.json")
    assert page["log"]["cut"]
    assert page["log"]["lines"][-1] == "last"
    assert all(len(line) <= 2000 for line in page["log"]["lines"])


def test_series_have_everybody_on_one_clock(run):
    site = site_of(run)
    (run / "cases" / CASES[0] / "attempt-1" / "kpi.parquet").unlink()
    found = read(site, f"runs/demo/cases/{CASES[0]}/series.json")
    assert found["t"] == [0.0, 0.05, 0.1, 0.15, 0.2, 0.25]
    ego = found["actors"][0]
    assert (ego["name"], len(ego["x"]), ego["size"][0]) == ("ego", 6, pytest.approx(4.98))
    assert [hull["kind"] for hull in found["road"]["hulls"]] == ["obstacle", "parked", "building"]
    assert len(found["road"]["lines"]) == 5
    assert {"label", "x", "y", "w", "h"} == set(found["detections"][0]["boxes"][0])
    bare = read(site, f"runs/demo/cases/{CASES[3]}/series.json")
    assert bare["road"] is None
    assert bare["detections"] == []
    assert read(site, f"runs/demo/cases/{CASES[2]}/case.json")["film"] is None


def test_pictures_show_the_decisive_moment(run):
    kpi(run / "cases" / CASES[1] / "attempt-1", collisions=(1, 1, 1))
    site = site_of(run)
    assert read(site, "runs/demo/pictures/atlas.json")["has"] == [True, True, False, False]
    shades = [
        picture_from(site.answer(f"runs/demo/cases/{case}/moment.webp").data).mean()
        for case in CASES[:2]
    ]
    assert shades == [pytest.approx(10, abs=8), pytest.approx(10, abs=8)]
    sheet = picture_from(site.answer("runs/demo/pictures/160x90/0.webp").data)
    assert sheet.shape == (720, 1280, 3)
    film = picture_from(site.answer(f"runs/demo/cases/{CASES[0]}/film/0.webp").data)
    columns = [float(np.mean(film[:, 64 * k + 32])) for k in range(3)]
    assert columns == [pytest.approx(shade, abs=8) for shade in (10, 120, 230)]


def test_a_false_braking_opens_at_the_trigger_and_not_where_it_stands(tmp_path):
    said = {"verdict": "false_braking", "outcome": "verdict"}
    run = a_run(tmp_path / "demo", **{CASES[1].replace("-", "__"): said})
    for case in CASES[:2]:
        kpi(run / "cases" / case / "attempt-1", dtc_m=(9.0, 8.0, 7.0))
    site = site_of(run)
    found = [read(site, f"runs/demo/cases/{case}/case.json")["moment"] for case in CASES[:2]]
    assert found == [{"t": 0.1, "what": "closest"}, {"t": 0.05, "what": "trigger"}]


def test_a_second_attempt_of_an_idle_worker_is_said(tmp_path):
    names = {case.replace("-", "__"): {"attempts": 2} for case in CASES[:3]}
    run = a_run(tmp_path / "demo", **names)
    events = [
        ("leased", CASES[0], 1, "w1"),
        ("leased", CASES[1], 2, "w2<"),
        ("leased", CASES[1], 3, "w1"),
        ("committed", CASES[1], 3, "w1"),
        ("late", CASES[1], 2, "w2<"),
        ("lost", CASES[0], 1, ""),
        ("leased", CASES[0], 4, "w2"),  # the first one was lost before: its charge says so
    ]
    keys = ("event", "case", "token", "worker")
    lines = [json.dumps({"at_s": 1.0, **dict(zip(keys, event, strict=True))}) for event in events]
    (run / "timeline.jsonl").write_text("\n".join([*lines[:3], '{"torn', "[]", *lines[3:]]))
    site = site_of(run)
    found = [read(site, f"runs/demo/cases/{case}/case.json")["attempts"] for case in CASES[:3]]
    said = ["w1 was idle and began it as well, while w2< had it"]
    assert [attempts["doubles"] for attempts in found] == [[], said, []]
    assert [attempts["count"] for attempts in found] == [2, 2, 2]


def test_a_damaged_recording_is_a_case_without_pictures(run):
    (run / "cases" / CASES[0] / "attempt-1" / "recording.rrd").write_bytes(b"RRF2" + bytes(50))
    site = site_of(run)
    page = read(site, f"runs/demo/cases/{CASES[0]}/case.json")
    assert page["film"] is None
    assert page["links"]["recording"] is not None, "whoever wants the file may have it"
    with pytest.raises(UsageError):
        site.answer(f"runs/demo/cases/{CASES[0]}/moment.webp")
    site.answer("runs/demo/pictures/80x45/0.webp")


@pytest.mark.parametrize(
    "text", ["", "{", '{"campaign": 1}', '{"campaign": "a", "cases": {"c": 1}}', "\0"]
)
def test_damaged_outcomes_are_one_line(run, text):
    (run / "outcomes.json").write_text(text)
    with pytest.raises(InfrastructureError, match="damaged") as refused:
        site_of(run).answer("runs/demo/table.json")
    assert "\n" not in str(refused.value)


def test_a_campaign_file_that_cannot_be_read_costs_the_axes_only(run):
    (run / "campaign.yaml").write_text("campaign: [")
    about = read(site_of(run), "runs/demo/run.json")
    assert about["axes"] == []
    assert about["cases"] == 4


def test_a_run_that_has_begun_and_one_that_waits(tmp_path):
    run = a_run(tmp_path / "demo")
    (run / "outcomes.json").unlink()
    (row,) = read(site_of(run), "runs.json")["runs"]
    assert (row["state"], row["cases"], row["done"]) == ("waiting", 4, 0)
    assert read(site_of(run), "runs/demo/table.json")["columns"]["verdict"] == [None] * 4


def test_several_campaigns_and_two_of_one_name(tmp_path):
    for name in ("x", "y"):
        a_run(tmp_path / name, recorded=())
    site = site_of(tmp_path)
    assert list(site.runs) == ["x", "y"]
    site.add(RunFolder(a_run(tmp_path / "more" / "x", recorded=())), keep=False)
    assert list(site.runs) == ["x", "y", "x-2"]
    assert read(site, "runs/x-2/run.json")["cases"] == 4
    with pytest.raises(UsageError, match="not a campaign folder"):
        find_runs(tmp_path / "x" / "cases" / CASES[0])
    with pytest.raises(UsageError):
        find_runs(tmp_path / "nowhere")


def test_every_address_that_is_told_has_a_content(run):
    site = site_of(run)
    told = list(site.addresses())
    assert len(told) == len(set(told))
    for address in told:
        assert site.answer(address).data
    assert f"runs/demo/cases/{CASES[0]}/film/0.webp" in told
    assert not any("moment" in address and CASES[3] in address for address in told)


@pytest.mark.parametrize(
    "address",
    [
        *("", "/", "runs", "runs.json/", "runs/demo", "runs/demo/", "runs/demo/cases"),
        *("runs/demo/cases//case.json", "runs/demo/cases/%2e%2e/case.json"),
        *("runs/demo/pictures/160x90/1.webp", "runs/demo/pictures/160x90/٣.webp"),
        *("runs/demo/pictures/160x90/9999999.webp", "runs/demo/pictures/0x0/0.webp"),
        *("runs/demo/search.json", "compare/demo/demo", "compare/demo/x.json"),
        *("runs/demo/../demo/run.json", "runs/demo/cases/%ff/case.json", "events"),
    ],
)
def test_other_addresses_are_refused(run, address):
    with pytest.raises(TwinError):
        site_of(run).answer(address)
