"""Failures of a real search become cases of a regression campaign, and come out the same there."""

from __future__ import annotations

import html
import os
import re
import sys
from pathlib import Path

import pytest
from processes import Marked, nothing_left, outcomes

from conductor.records.search import read_search
from conductor.run.regression import regress
from schemas.files.yaml_file import load_yaml
from twin.base.errors import UsageError

STACK = '''
import zlib

from devkit.stack import Stack
from schemas.messages import Command


class Blind(Stack):
    """Drives for a time that its case's name and seed decide, then brakes."""

    def reset(self, slot, episode):
        self.until = getattr(self, "until", {})
        drawn = zlib.crc32(f"{episode.case}/{episode.seed}".encode()) % 20
        self.until[slot] = 90 + drawn

    def step(self, observation):
        commands = []
        for slot in observation.active_slots():
            tick, token = int(observation.tick[slot]), int(observation.token[slot])
            go = tick < self.until[slot]
            commands.append(Command(slot, token, tick, 0.6 * go, 1.0 - go, 0.0))
        return commands
'''

CAMPAIGN = """
campaign: {name}
seed: {seed}
render: false
scenario: {{duration_s: 12}}
autonomy: {{stack: "{stack}", placement: inline, latency_jitter_ms: 150, drop: 0.3}}
matrix: {{weather: [heavy_rain]}}
search:
  parameters:
    scenario.ego_start_m: {{distribution: uniform, low: 20, high: 50}}
    environment.friction: {{distribution: uniform, low: 0.3, high: 1.0}}
  objective: {{kpi: dtc_min_m, fails_below: 1.0}}
  budget: {{cases: 8, generation: 4}}
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with the stack, which is on the path of all processes."""
    folder = tmp_path_factory.mktemp("regress")
    (folder / "blind_stack.py").write_text(STACK)
    (folder / "other_stack.py").write_text(STACK)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{folder}:{os.environ.get('PYTHONPATH', '')}")
        patch.syspath_prepend(str(folder))
        yield folder


def _run(home: Path, file: Path, out: Path) -> Path:
    starter = Marked()
    try:
        with nothing_left(starter):
            words = ("run", str(file), "--workers", "1", "--out", str(out))
            done = starter.run("conductor", *words)
    finally:
        starter.end()
    assert done.returncode in (0, 1), done.stderr
    return out


@pytest.fixture(scope="module")
def searched(home):
    """A search that has ended."""
    return _searched(home, "hunt", 3, "blind_stack:Blind")


def _searched(home: Path, name: str, seed: int, stack: str) -> Path:
    file = home / f"{name}.yaml"
    file.write_text(CAMPAIGN.format(name=name, seed=seed, stack=stack))
    return _run(home, file, home / f"run-{name}")


def test_every_cluster_becomes_a_case_with_the_same_kpis(home, searched, marked):
    file = home / "kept.yaml"
    found = read_search(searched)
    clusters = [cluster.mildest for cluster in found.clusters]
    assert clusters
    done = marked.run("conductor", "regress", str(searched), "--into", str(file))
    assert done.returncode == 0, done.stderr
    other = next(name for name in found.generations[1].cases if name not in clusters)
    text = file.read_text().replace("cases:", "# a line of mine\ncases:")
    file.write_text(text)
    done = marked.run("conductor", "regress", str(searched), "--into", str(file), "--case", other)
    assert done.returncode == 0, done.stderr
    assert file.read_text().startswith(text)
    again = outcomes(_run(home, file, home / "run-kept"))
    before = outcomes(searched)
    assert set(again) == {f"hunt-3-{name}" for name in [*clusters, other]}
    for name in [*clusters, other]:
        assert again[f"hunt-3-{name}"]["kpi_sha256"] == before[name]["kpi_sha256"]
        assert again[f"hunt-3-{name}"]["scalars"] == before[name]["scalars"]
    # The numbers are drawn: without its origin a case comes to others.
    plain = home / "plain.yaml"
    plain.write_text(
        "".join(line.replace("- drawn_as", "- repeat: 0 #") + "\n" for line in text.splitlines())
    )
    values = {case["kpi_sha256"] for case in outcomes(_run(home, plain, home / "plain")).values()}
    assert not values & {case["kpi_sha256"] for case in before.values()}
    # A case that repeats another can be kept as well: as that other.
    twice = home / "twice.yaml"
    assert regress(home / "run-kept", [f"hunt-3-{other}"], twice) == [f"hunt-3-{other}"]
    assert load_yaml(twice)["cases"][0]["drawn_as"] == f"hunt/3/{other}"


def test_commands_of_a_report_leave_the_run_as_it_was_signed(home, searched, marked, monkeypatch):
    """As they stand on the page: typed in the folder that holds the run's, with its stack found."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    page = (searched / "report.html").read_text()
    found = f"that holds <code>{searched.name}</code>, where its stack blind_stack:Blind is found"
    assert page.count(found) == 3
    blocks = re.findall(r"<pre><code>((?:conductor|viewer) [^<]*)</code></pre>", page)
    commands = [line for block in blocks for line in html.unescape(block).splitlines()]
    mildest = read_search(searched).clusters[0].mildest
    first = f"conductor run {searched.name}/campaign.yaml --case {mildest} --out again-{mildest}"
    assert commands[0] == first
    assert commands[1] == f"conductor regress {searched.name} --into kept.yaml"
    (home / "kept.yaml").unlink(missing_ok=True)
    last = [line for line in commands if line.startswith("conductor fingerprint ")]
    said = []
    for command in [*commands[:2], *commands[-3:]]:
        child = marked.start(prefix=("bash", "-c", command), folder=home)
        out, err = child.communicate()
        assert child.returncode in (0, 1), f"{command}\n{out}\n{err}"
        said.append(out)
    assert len(last) == 2
    assert said[-1].split()[0] == said[-2].split()[0]  # of the run and of its repetition
    done = marked.run("conductor", "verify", str(searched))
    assert done.returncode == 0, done.stdout + done.stderr


def _refused(*arguments) -> str:
    with pytest.raises(UsageError) as error:
        regress(*arguments)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_does_not_fit_is_one_line_and_writes_nothing(home, searched, tmp_path):
    file = tmp_path / "kept.yaml"
    name = read_search(searched).clusters[0].mildest
    regress(searched, [name], file)
    before = file.read_text()
    assert _refused(searched, [], file).endswith(f"has hunt/3/{name} already; nothing was added")
    assert "no case of" in _refused(searched, ["g0099-0000"], file)
    other = next(each for each in outcomes(searched) if each != name)
    file.write_text(before.replace("blind_stack", "other_stack"))
    assert "has another stack than" in _refused(searched, [other], file)
    file.write_text(before.replace("drop: 0.3", "drop: 0.2"))
    assert "has another 'drop' than" in _refused(searched, [other], file)
    file.write_text(before.replace("duration_s: 12.0", "duration_s: 12.5"))
    assert "has another 'scenario' than" in _refused(searched, [other], file)
    file.write_text("campaign: kept\ncases: [{repeat: 1}]\n")
    assert "a list with a line for each" in _refused(searched, [other], file)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.yaml"]
    assert "a campaign is named as its file" in _refused(searched, [other], tmp_path / "K ept.yaml")
    assert "no outcomes.json" in _refused(tmp_path, [], file)


def test_a_run_without_a_search_wants_names(tmp_path, home, searched):
    file = home / "kept-one.yaml"
    name = read_search(searched).clusters[0].mildest
    regress(searched, [name], file)
    run = _run(home, file, home / "run-one")
    assert "no search was run there; name its cases with --case" in _refused(
        run, [], tmp_path / "a.yaml"
    )
