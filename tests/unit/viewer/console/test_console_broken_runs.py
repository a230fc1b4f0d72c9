"""A run folder that is damaged, in a list beside one that is whole: it is listed with one line that
says what is wrong, and every other answer is as it was."""

import json
import os
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.viewer.console.console_runs import CASES, a_run

from twin.base.errors import TwinError
from viewer.browser.front import built_pages
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
from viewer.console.static_site import write_static

ATTEMPT = f"cases/{CASES[0]}/attempt-1"
DEEP = b"[" * 200_000
PLACES = (
    *("outcomes.json", "campaign.yaml", "timeline.jsonl", "manifest.json", "search.json"),
    *("rulebook.json", "resources.parquet", "report.html"),
    *(f"{ATTEMPT}/{name}" for name in ("kpi.parquet", "recording.rrd", "log.txt")),
)
WRITTEN = (*PLACES[:4], *PLACES[-3:])
"""Those that every run here has."""
CONTENTS = {
    "zeros": bytes(4096),
    "nothing": b"",
    "text": b"\xff\xfe not what it should be\n\x1b[2J",
    "deep": DEEP,
    "deep-keys": b'{"a":' * 50_000,
    "deep-lines": b'{"at_s": 1, "x": ' + DEEP + b"\n",
    "other": b'{"campaign": {}, "cases": [], "fingerprint": [1], "at_s": "x"}',
    "numbers": b'{"at_s": 1e999, "campaign": "a", "cases": {"a": {"wall_s": 1e308}}}',
    "parquet": b"PAR1" + bytes(100) + b"PAR1",
}
OF_A_RUN = ("run.json", "table.json", "workers.json", "search.json", "rulebook.json")
PICTURES = ("pictures/atlas.json", "pictures/80x45/0.webp")
OF_A_CASE = ("case.json", "series.json", "moment.webp", "film/0.webp")
ADDRESSES = (
    *OF_A_RUN,
    *PICTURES,
    *(f"cases/{case}/{name}" for case in CASES[:2] for name in OF_A_CASE),
)


def two_runs(folder):
    """A run that will be damaged, and one that stays whole."""
    a_run(folder / "whole", recorded=CASES[:1])
    return a_run(folder / "bad", recorded=CASES[:1])


@contextmanager
def damaged(run, place, put):
    """A run of which one file is something else meanwhile: ``put`` makes it at its path."""
    path, beside = run / place, run.parent / "whole-file"
    there = path.exists()
    if there:
        path.rename(beside)
    try:
        put(path)
        yield
    finally:
        path.rmdir() if path.is_dir() else path.unlink()
        if there:
            beside.rename(path)


def answers(site, run):
    """Of each address its bytes, or the line that refuses it."""
    found = {}
    for address in ADDRESSES:
        try:
            found[address] = site.answer(f"runs/{run}/{address}").data
        except (TwinError, OSError) as error:
            found[address] = str(error)
    refusals = [line for line in found.values() if isinstance(line, str)]
    assert not any("\n" in line for line in refusals), refusals
    return found


def rows(site):
    """The list, by campaign."""
    return {row["id"]: row for row in json.loads(site.answer("runs.json").data)["runs"]}


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Two runs whose damage is mended after every try."""
    folder = tmp_path_factory.mktemp("kept")
    run = two_runs(folder)
    (run / "timeline.jsonl").write_text('{"at_s":100.0,"event":"leased","worker":"w1"}\n' * 3)
    (run / "manifest.json").write_text('{"fingerprint": "abc"}')
    return folder


@pytest.fixture(scope="module")
def alone(kept):
    """Row and answers of the whole run where there is no other."""
    site = ConsoleSite(find_runs(kept / "whole"), keep=False)
    return rows(site)["whole"], answers(site, "whole")


def check(folder, alone):
    """The list says one line of the damaged run at most, and the whole one is as it always was."""
    site = ConsoleSite(find_runs(folder), keep=False)
    told = rows(site)
    assert set(told) == {"bad", "whole"}
    assert told["whole"]["error"] is None
    wrong = told["bad"]["error"]
    assert (told["bad"]["state"] == "damaged") == (wrong is not None)
    assert wrong is None or (wrong.isprintable() and len(wrong) < 500)
    site.warm()
    of_bad = answers(site, "bad")
    assert (told["whole"], answers(site, "whole")) == alone
    if wrong is not None:
        assert of_bad["run.json"] == of_bad["table.json"] == wrong
    return told["bad"], of_bad


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("content", CONTENTS)
def test_one_damaged_file_is_one_line_and_no_other_answer_suffers(kept, alone, place, content):
    with damaged(kept / "bad", place, lambda path: path.write_bytes(CONTENTS[content])):
        row, found = check(kept, alone)
    if place == "outcomes.json" and content != "numbers":
        assert "outcomes.json: damaged" in row["error"]
    elif place != "outcomes.json":
        assert row["error"] is None
        assert isinstance(found["table.json"], bytes), "its cases are known"
        assert row["cases"] == 4


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "put", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to(path)], ids=["dir", "pipe", "loop"]
)
def test_what_is_no_file_is_not_opened(kept, alone, place, put):
    with damaged(kept / "bad", place, put):
        check(kept, alone)


@settings(max_examples=60, deadline=None)
@given(
    place=st.sampled_from(WRITTEN),
    at=st.floats(0, 1),
    cut=st.booleans(),
    put=st.binary(min_size=0, max_size=8),
)
def test_any_change_of_bytes_leaves_the_others_alone(kept, alone, place, at, cut, put):
    path = kept / "bad" / place
    good = path.read_bytes()
    split = int(at * len(good))
    try:
        path.write_bytes(good[:split] + put + (b"" if cut else good[split + len(put) :]))
        check(kept, alone)
    finally:
        path.write_bytes(good)


AS_NOBODY = """
import json, os, sys
from pathlib import Path
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
folder = Path(sys.argv[1])
os.setgid(65534); os.setgroups([]); os.setuid(65534)
site = ConsoleSite(find_runs(folder), keep=False)
site.warm()
print(json.dumps([site.runs_json()["runs"], len(site.answer("runs/whole/table.json").data)]))
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="takes rights away: needs root")
@pytest.mark.parametrize("closed", [".", "cases", "outcomes.json"])
def test_a_run_without_rights_is_listed_as_such(closed):
    with tempfile.TemporaryDirectory() as made:  # below a folder that everybody may enter
        folder = Path(made)
        folder.chmod(0o755)
        run = two_runs(folder)
        if closed == "cases":
            (run / "outcomes.json").unlink()
        (run / closed).chmod(0)
        words = [sys.executable, "-c", AS_NOBODY, made]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told, size = json.loads(done.stdout)
    errors = {row["id"]: row["error"] for row in told}
    assert errors["whole"] is None
    assert "Permission denied" in errors["bad"]
    assert size


def test_files_are_written_of_the_others(tmp_path):
    (two_runs(tmp_path / "runs") / "outcomes.json").write_bytes(bytes(100))
    site = ConsoleSite(find_runs(tmp_path / "runs"), keep=False)
    out = tmp_path / "out"
    written = write_static(site, built_pages(), out, recordings=False)
    (line,) = [line for line in written.left_out if line.startswith("bad: ")]
    assert "outcomes.json: damaged" in line
    assert (out / "data/runs/whole/table.json.js").is_file()
    assert not (out / "data/runs/bad").exists()
