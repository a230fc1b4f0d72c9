"""The console as files: what they hold is what the served one answers."""

import json

import pytest
from unit.viewer.console.console_runs import CASES, a_run

from twin.base.errors import UsageError
from viewer.browser.assets import Asset
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
from viewer.console.static_site import as_script, write_static
from viewer.playback.folder import find_recording

PAGES = {"index.html": Asset(b"<!doctype html><html lang='en'><body>", "text/html", "1")}


@pytest.fixture
def run(tmp_path):
    return a_run(tmp_path / "demo")


def site_of(run):
    return ConsoleSite(find_runs(run), keep=False)


def without_links(data):
    """A case without what only a server gives."""
    page = json.loads(data)
    page["links"] |= {"in_full": None, "recording": None}
    return json.dumps(page)


def told(script):
    """Address and value that a script hands to the page."""
    address, text = json.loads("[" + script.removeprefix("consoleData(").removesuffix(");\n") + "]")
    return address, json.loads(text)


def test_static_equals_served(run, tmp_path):
    site, out = site_of(run), tmp_path / "out"
    written = write_static(site, PAGES, out, recordings=False)
    assert written.left_out == []
    for address in site.addresses():
        data = site.answer(address).data
        if address.endswith("/case.json"):
            assert json.loads(data)["links"]["incomplete"] is not True
            assert str(tmp_path) not in json.loads(data)["repeat"], "it is read elsewhere"
            data = without_links(data)
        if address.endswith(".json"):
            script = (out / "data" / f"{address}.js").read_text()
            assert told(script) == (address, json.loads(data))
        else:
            assert (out / "data" / address).read_bytes() == data
    files = [path for path in out.rglob("*") if path.is_file()]
    assert len(files) == written.files
    assert sum(path.stat().st_size for path in files) == written.size_bytes
    assert b"<html data-static lang='en'>" in (out / "index.html").read_bytes()
    assert (out / "plotly.js").stat().st_size > 1_000_000
    assert not (out / "recording").exists()
    assert not (run / ".console").exists(), "nothing is written into the run"


def test_recordings_and_the_report_if_asked(run, tmp_path):
    (run / "report.html").write_text("report")
    out = tmp_path / "out"
    write_static(site_of(run), PAGES, out, recordings=True)
    assert (out / "report/demo/report.html").read_text() == "report"
    copies = sorted(path.name for path in (out / "recording/demo").iterdir())
    assert copies == [f"{case}.rrd" for case in CASES[:2]]
    links = [links_of(out, case) for case in CASES[1:3]]
    assert [link["recording"] for link in links] == [f"recording/demo/{CASES[1]}.rrd", None]
    assert all(link["in_full"] is None for link in links)
    source = run / "cases" / CASES[0] / "attempt-1" / "recording.rrd"
    assert (out / "recording/demo" / copies[0]).read_bytes() == source.read_bytes()


def test_what_ends_a_line_or_a_script_stays_in_its_text():
    value = {"__proto__": "</script>\u2028\u2029", 'a"b\\': "\n"}
    script = as_script("runs/a%20b/x.json", json.dumps(value, ensure_ascii=False).encode())
    assert "\u2028" not in script.decode()
    assert script.count(b"\n") == 1
    assert told(script.decode()) == ("runs/a b/x.json", value)


@pytest.mark.parametrize("place", ["demo", "demo/cases/new", "full"])
def test_other_folders_are_refused_in_one_line(run, tmp_path, place):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("")
    with pytest.raises(UsageError, match="--static") as refused:
        write_static(site_of(run), PAGES, tmp_path / place, recordings=False)
    assert "\n" not in str(refused.value)


def test_a_page_that_is_not_built_is_one_line(run, tmp_path):
    with pytest.raises(UsageError, match="make console"):
        write_static(site_of(run), {}, tmp_path / "out", recordings=False)


def test_a_case_that_cannot_be_read_is_told_and_left_out(run, tmp_path):
    site = site_of(run)
    site.runs["demo"].recorded()
    (run / "cases" / CASES[0] / "attempt-1" / "recording.rrd").unlink()
    written = write_static(site, PAGES, tmp_path / "out", recordings=False)
    assert [line.partition(":")[0] for line in written.left_out] == [
        f"runs/demo/cases/{CASES[0]}/moment.webp"
    ]


def links_of(out, case):
    return told((out / f"data/runs/demo/cases/{case}/case.json.js").read_text())[1]["links"]


def test_what_cannot_be_read_is_left_out_with_a_line(run, tmp_path, monkeypatch):
    site, answer = site_of(run), ConsoleSite.answer

    def lets_down(self, address):
        if address.endswith(f"{CASES[0]}/series.json"):
            raise OSError(5, "Input/output error")
        return answer(self, address)

    monkeypatch.setattr(ConsoleSite, "answer", lets_down)
    monkeypatch.setattr("viewer.console.static_site.find_recording", gone(CASES[1]))
    written = write_static(site, PAGES, tmp_path / "out", recordings=True)
    assert len(written.left_out) == 2
    assert f"{CASES[1]}.rrd: not there" in written.left_out[0]
    assert f"{CASES[0]}/series.json: [Errno 5] Input/output error" in written.left_out[1]
    assert links_of(tmp_path / "out", CASES[0])["recording"]
    assert links_of(tmp_path / "out", CASES[1])["recording"] is None


def gone(name):
    """Finds recordings, but not of one case."""

    def find(folder, case):
        if case == name:
            raise UsageError("not there")
        return find_recording(folder, case)

    return find


def test_a_run_that_is_damaged_does_not_take_the_others_along(run, tmp_path):
    site = ConsoleSite([*find_runs(run), *find_runs(a_run(tmp_path / "bad", recorded=()))])
    (tmp_path / "bad" / "outcomes.json").write_text("{")
    written = write_static(site, PAGES, tmp_path / "out", recordings=False)
    assert any(line.startswith("bad: ") for line in written.left_out)
    assert (tmp_path / f"out/data/runs/demo/cases/{CASES[3]}/case.json.js").is_file()
