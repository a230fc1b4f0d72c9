"""Imported logs and comparisons in a real browser, made by the real commands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from unit.conductor.report.autodrive_logs import config, drive, write_logs

sync_api = pytest.importorskip("playwright.sync_api", reason="install the package 'playwright'")

CHROMIUM = Path("/usr/bin/chromium")
PATIENCE_MS = 120_000
"""How long a page may take on a loaded machine [ms]."""

pytestmark = pytest.mark.skipif(
    not CHROMIUM.exists(), reason="no browser: install the Debian package 'chromium'"
)


def test_logs_of_two_versions_from_the_files_to_the_pages(marked, tmp_path):
    """The same logs twice, then with a case in which the second version hits; a name that is HTML
    is text in every page."""
    data = config(("yolov2", "<img src=x onerror=alert(1)>"))

    def worse(instance):
        hit = instance["model"] == "yolov2" and instance["weather_id"] == 4
        return drive(instance, brake_m=2.0, stop_m=0.0) if hit else drive(instance)

    write_logs(tmp_path / "v1", data)
    write_logs(tmp_path / "v2", data, worse)
    cut = tmp_path / "v2" / "batch_1" / "aeb_metrics_sim_inst_1.csv"
    cut.write_text(cut.read_text() + "2024-03-18 16:59:0")
    runs = [tmp_path / "runs" / name for name in ("a", "b", "c")]
    for source, run in zip(("v1", "v1", "v2"), runs, strict=True):
        logs = ("--import-autodrive", str(tmp_path / source), "--out", str(run))
        done = marked.run("conductor", "report", *logs, "--output", "json")
        assert done.returncode == (1 if source == "v2" else 0), done.stderr
    assert "batch_1/aeb_metrics_sim_inst_1.csv: line 133 left out: cut off" in done.stderr
    assert json.loads(done.stdout)["passed"] == 6
    same = marked.run("conductor", "compare", str(runs[0]), str(runs[1]))
    assert (same.returncode, same.stderr) == (0, "")
    assert same.stdout.startswith("identical (bytes): 8 cases")
    html = tmp_path / "compare.html"
    done = marked.run("conductor", "compare", str(runs[0]), str(runs[2]), "--html", str(html))
    assert done.returncode == 1
    assert "regression: 2 cases have become worse" in done.stdout

    complaints = []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-dev-shm-usage"]
        )
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda m: complaints.append(m.text) if m.type != "log" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: complaints.append(dialog.message))
        page.goto(html.as_uri())
        assert page.locator("#result h2").inner_text() == "regression: 2 cases have become worse"
        flips = page.locator("section", has_text="Verdicts that changed").locator("tbody tr")
        assert [flip.split("\t")[0] for flip in flips.all_inner_texts()] == [
            "yolov2-0500-heavy_fog",
            "yolov2-1300-heavy_fog",
        ]
        page.goto((runs[2] / "report.html").as_uri())
        sync_api.expect(page.locator("#curves .main-svg").first).to_be_visible(timeout=PATIENCE_MS)
        assert "8 logs of the AutoDRIVE study" in page.locator("#imported").inner_text()
        left_out = page.locator("#left-out li").all_inner_texts()
        assert any("line 133 left out: cut off" in line for line in left_out)
        assert any("<img src=x onerror=alert(1)>" in line for line in left_out)
        assert page.locator("img[src=x]").count() == 0
        browser.close()
    assert complaints == []
