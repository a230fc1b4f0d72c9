"""drivetwin.arguments, and what is said before a run: a line per mistake."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from IPython.core.formatters import HTMLFormatter

import drivetwin
from devkit.idle import IdleStack
from drivetwin.arguments import changes_of, entry_point, request_of
from drivetwin.finished import RunReport

HEAVY = ("numpy", "pyarrow", "warp", "cv2", "zenoh", "rerun", "rich", "typer", "asyncio")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"worker": 1}, "run: no argument 'worker'; did you mean 'workers'?"),
        ({"view": "all"}, "view: given 'all', allowed: live, none, record, record+live"),
        ({"slots": 0}, "slots: given 0, allowed: from 1"),
        ({"slots": "4"}, "slots: given '4', allowed: int"),
        ({"cases": True}, "cases: given True, allowed: int"),
        ({"seed": -1}, "seed: given -1, allowed: from 0"),
        ({"workers": 1.5}, "workers: given 1.5, allowed: int or str"),
        ({"case": 3}, "case: given 3, allowed: str"),
        ({"rows": 3}, "rows: given 3, allowed: str or list or tuple"),
        ({"out": 3}, "out: given 3, allowed: str or Path"),
        ({"quick": "yes"}, "quick: given 'yes', allowed: bool"),
        ({"memory_gb": 0.0}, "memory_gb: given 0.0, allowed: 0.1 to 1000000"),
        ({"axes": ["clear"]}, "axes: expected a mapping"),
        ({"settings": "seed"}, "settings: expected a mapping"),
        ({"settings": {1: 2}}, "key of settings: given 1, allowed: str"),
        ({"axes": {None: ["clear"]}}, "key of axes: given None, allowed: str"),
    ],
)
def test_an_argument_that_is_none(given, said):
    with pytest.raises(drivetwin.UsageError) as caught:
        request_of("aeb-demo", given)
    assert str(caught.value).startswith(said)
    assert len(str(caught.value).splitlines()) == 1


def test_a_campaign_is_a_name_or_a_path():
    with pytest.raises(drivetwin.UsageError, match=r"campaign: given \{\}, allowed: str or Path"):
        request_of({}, {})  # type: ignore[arg-type]


def test_arguments_are_the_options_of_the_command_line():
    request = request_of("x.yaml", {"workers": 2, "rows": ["a", "b"], "view": "record", "out": "o"})
    assert (request.workers, request.rows, str(request.out)) == ("2", "a,b", "o")
    assert request.view is not None
    assert request.view.records
    assert request_of("x", {"seed": None}) == request_of("x", {})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"axes": {"wether": ["clear"]}}, "axes.wether: unknown axis; did you mean 'weather'?"),
        ({"axes": {"weather": ["cler"]}}, "axes.weather: given 'cler'; did you mean 'clear'?"),
        ({"axes": {"weather": "clear"}}, "axes: 'weather' takes a list of values, e.g. ['clear']"),
        ({"axes": {"weather": []}}, "axes: 'weather' takes a list of values"),
        ({"settings": {"camera.widht": 3}}, "aeb-demo.yaml: camera.widht: unknown key"),
        ({"settings": {"seed.x": 3}}, "settings: 'seed.x': 'seed' is a value and has no keys"),
        ({"settings": {".x": 3}}, "settings: '.x': expected the path of a key"),
        ({"settings": {"autonomy.stack": "no_such_module:S"}}, "aeb-demo.yaml: autonomy.stack:"),
    ],
)
def test_a_change_that_is_none(changes, said):
    with pytest.raises(drivetwin.UsageError) as caught:
        drivetwin.validate("aeb-demo", **changes)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    ("seed", "said"),
    [
        (-1, "seed: given -1, allowed: from 0"),
        ("5", "seed: given '5', allowed: int"),
        (2**63, "seed: given 9223372036854775808, allowed: 0 to 9223372036854775807"),
    ],
)
def test_a_seed_that_is_none(seed, said):
    with pytest.raises(drivetwin.UsageError) as caught:
        drivetwin.validate("aeb-demo", seed=seed)
    assert str(caught.value) == said
    assert drivetwin.validate("aeb-demo", seed=2**63 - 1).seed == 2**63 - 1


def test_changes_take_the_place_of_the_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        json.dumps(
            {
                "campaign": "mine",
                "simulator": "noop",
                "matrix": {"repeat": [0, 1], "weather": ["clear", "cloudy"]},
            }
        )
    )
    found = drivetwin.validate(
        path, axes={"weather": ["heavy_fog"]}, settings={"campaign": "other"}, seed=5
    )
    assert (found.name, found.seed) == ("other", 5)
    assert len(found.cases) == 2
    assert all("heavy_fog" in case for case in found.cases)
    path.write_text(json.dumps({"campaign": "mine", "cases": [{"weather": "clear"}]}))
    with pytest.raises(drivetwin.UsageError, match=r"axes: .*mine.yaml lists its cases"):
        drivetwin.validate(path, axes={"weather": ["clear"]})


def test_a_class_stands_for_its_file():
    assert entry_point(IdleStack) == "devkit.idle:IdleStack"
    assert entry_point("mine:Stack") == "mine:Stack"

    class Inner:
        pass

    for lost in (Inner, type("Cell", (), {"__module__": "__main__"})):
        with pytest.raises(drivetwin.UsageError, match=r"%%writefile my_stack\.py") as caught:
            changes_of(None, {"autonomy.stack": lost})
        assert len(str(caught.value).splitlines()) == 1


def test_shipped_campaigns_are_listed():
    found = {campaign.name: campaign for campaign in drivetwin.campaigns()}
    assert found["aeb-demo"].cases == 8
    assert found["aeb-search"].cases == 120
    assert all(campaign.description for campaign in found.values())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"gpu": 1}, "submit: no option 'gpu'; did you mean 'gpus'?"),
        ({"scheduler": "slrum"}, "scheduler: given 'slrum'; did you mean 'slurm'?"),
        ({"gpus": "4"}, "gpus: given '4', allowed: a number from 0"),
        ({"gpus": -1}, "gpus: given -1, allowed: a number from 0"),
        ({"workers": 1, "time": "soon"}, "--time 'soon': expected HH:MM"),
        ({"site": "nowhere.yaml", "workers": 1}, "nowhere.yaml"),
        ({"time": 5}, "time: given 5, allowed: str"),
        ({"out": 5}, "out: given 5, allowed: str or Path"),
        ({"signal_lead": "60"}, "signal_lead: given '60', allowed: a number from 0"),
        ({"gpus": True}, "gpus: given True, allowed: a number from 0"),
        ({"directive": "--qos=long"}, "directive: given '--qos=long', allowed: list or tuple"),
        ({"container_bind": [5]}, "container_bind: given 5, allowed: str or Path"),
        ({"account": 5}, "account: given 5, allowed: str"),
    ],
)
def test_a_submission_that_is_none(options, said):
    with pytest.raises(drivetwin.UsageError) as caught:
        drivetwin.submit("aeb-demo", **{"time": "01:00", **options})
    assert str(caught.value).startswith(said)


def test_a_folder_that_is_no_run(tmp_path):
    with pytest.raises(drivetwin.UsageError, match=r"no outcomes\.json"):
        drivetwin.open(tmp_path)
    with pytest.raises(drivetwin.UsageError, match="out belongs to stores"):
        drivetwin.open(tmp_path, out="here")
    with pytest.raises(drivetwin.UsageError, match=r"no outcomes\.json"):
        drivetwin.compare(tmp_path, tmp_path)
    with pytest.raises(drivetwin.UsageError, match="open: given 5, allowed: str or Path"):
        drivetwin.open(5)  # type: ignore[arg-type]
    with pytest.raises(drivetwin.UsageError, match="compare: given 5, allowed: Run or str or Path"):
        drivetwin.compare(tmp_path, 5)  # type: ignore[arg-type]


def test_the_link_to_a_report_is_one_whatever_its_folder_is_called(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, link in (("a b#1", "a%20b%231"), ("javascript:x", "javascript%3Ax")):
        report = RunReport(Path(name) / "report.html", "2 of 2", embed=False)
        shown = HTMLFormatter()(report)
        assert f'href="{link}/report.html"' in shown
        assert f">{name}/report.html</a>" in shown


def test_the_import_loads_nothing_heavy():
    code = "import drivetwin, sys; print(*(m for m in sys.argv[1:] if m in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code, *HEAVY, "conductor.cli", "twin.base.start"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == ""


def test_the_import_leaves_signals_alone():
    code = (
        "import signal; before = [signal.getsignal(n) for n in (2, 15)]\n"
        "import drivetwin, drivetwin.changed, drivetwin.clusters\n"
        "import conductor.run.requested, conductor.run.command, viewer.playback.pixels\n"
        "print([signal.getsignal(n) for n in (2, 15)] == before)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"
