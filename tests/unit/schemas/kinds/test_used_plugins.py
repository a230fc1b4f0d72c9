"""Plug-ins: which a campaign uses, what its digest has of them, and which workers get its cases."""

import json
import subprocess
import sys

import pytest
from plugin_site import ROOT, beside

from schemas.identity import campaign_digest
from schemas.plan import parse_plan

PLAIN = {"campaign": "c", "matrix": {"weather": ["clear"]}}
STOPS = {**PLAIN, "scenario": {"type": "stop_line", "line_m": 4}}
FEELS = {**PLAIN, "sensors": {"thermometer": {"on": False}}}
SEES = {**PLAIN, "sensors": {"imu": {}}, "autonomy": {"rate_hz": 10}}

DIGESTS = """
import json, sys
from schemas.identity import campaign_digest
from schemas.kinds.plugins import lacking_plugins
from schemas.kinds.registry import installed_plugins
from schemas.plan import parse_plan
found = []
for data in json.load(sys.stdin):
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    found.append([plan.campaign.plugins, campaign_digest(plan.campaign, plan.cases)])
print(json.dumps([found, installed_plugins(), lacking_plugins()]))
"""

CONDUCTOR = """
import json, sys
import msgspec
from conductor_bench import Bench, hello, submit
from conductor.core.admit import admit
from schemas.identity import campaign_digest
from schemas.wire.control import Submit
campaign = json.load(sys.stdin)
bench = Bench()
assert not bench.ask(submit()).error
refused = bench.ask(Submit(1, {**campaign, "plugins": {"plugin-example": "0.9"}})).error
assert not bench.ask(Submit(1, campaign)).error
offers = {
    "none": {},
    "older": {"plugins": {"plugin-example": "0.9"}},
    "broken": {
        "plugins": {"plugin-example": "1.0"},
        "lacks": {"plug-in plugin-example": "it raises"},
    },
    "same": {"plugins": {"plugin-example": "1.0", "another": "7"}},
}
found = {}
for name, offer in offers.items():
    notes = bench.ask(hello(name, **offer)).status.get("notes", [])
    told = bench.explain("clear", "c")
    asked = bench.lease(name, k=9)
    found[name] = [notes, sorted({lease.case.variation.campaign for lease in asked}), told]
    bench.bye(name)
known = bench.state.campaigns["c"]
begun = {**known.campaign.plugins, "plugin-example": "0.9"}
known.campaign = msgspec.structs.replace(known.campaign, plugins=begun)
known.digest = campaign_digest(known.campaign, [each.case for each in known.ordered])
_, errors = admit(bench.state, Submit(1, campaign))
print(json.dumps([found, refused, *errors]))
"""


def said(env, code, given):
    """What ``code`` prints last, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=env,
        cwd=ROOT,
        input=json.dumps(given),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_digest_has_the_plugins_that_the_campaign_uses_and_no_others(tmp_path):
    every = [PLAIN, SEES, STOPS, FEELS]
    one, installed, lacking = said(beside(tmp_path / "1", "1.0"), DIGESTS, every)
    assert installed == {"plugin-example": "1.0"}
    assert lacking == {}
    assert [plugins for plugins, _ in one] == [{}, {}] + [{"plugin-example": "1.0"}] * 2
    # Without it: what does not use it keeps its bytes.
    for data, (_, digest) in zip(every[:2], one, strict=False):
        plan, _ = parse_plan(data)
        assert plan.campaign.plugins == {}
        assert campaign_digest(plan.campaign, plan.cases) == digest
    two, _, _ = said(beside(tmp_path / "2", "1.1"), DIGESTS, every)
    assert [a == b for (_, a), (_, b) in zip(one, two, strict=True)] == [True, True, False, False]


def test_a_worker_says_which_of_its_plugins_cannot_be_used(tmp_path):
    env = beside(tmp_path, "1.0")
    points = next(tmp_path.glob("*.dist-info")) / "entry_points.txt"
    points.write_text(points.read_text().replace("thermometer_kind:", "no_such_kind:"))
    found, installed, lacking = said(env, DIGESTS, [STOPS])
    assert installed == {"plugin-example": "1.0"} == found[0][0]
    line = lacking["plug-in plugin-example"]
    assert "no_such_kind" in line
    assert len(line) <= 200, "a conductor keeps no longer ones"


@pytest.fixture(scope="module")
def leased(tmp_path_factory):
    return said(beside(tmp_path_factory.mktemp("here"), "1.0"), CONDUCTOR, STOPS)


@pytest.mark.parametrize(
    ("worker", "reason"),
    [
        ("none", "has no plug-in 'plugin-example' 1.0; install it there"),
        ("older", "has plug-in 'plugin-example' 0.9, needed is 1.0"),
        ("broken", "cannot use plug-in 'plugin-example' 1.0, it raises"),
    ],
)
def test_a_worker_without_the_plugin_as_it_is_here_gets_no_case_that_needs_it(
    leased, worker, reason
):
    notes, campaigns, told = leased[0][worker]
    line = f"{worker}: {reason}; it gets no case of campaign 'c'"
    assert notes == [line]
    assert line in told
    assert campaigns == ["alpha"], "others have their cases"


def test_a_worker_with_the_same_plugin_gets_them(leased):
    notes, campaigns, _ = leased[0]["same"]
    assert notes == []
    assert "c" in campaigns


def test_a_campaign_of_another_version_is_refused_in_one_line(leased):
    assert leased[1] == (
        "c: uses plug-in 'plugin-example' 0.9 where it was submitted, the conductor has 1.0; "
        "install the same version on both sides"
    )


def test_a_run_that_was_begun_with_another_version_says_which(leased):
    assert leased[2].startswith("c: ")
    assert "was begun with plug-in 'plugin-example' 0.9, installed is 1.0; put it back" in leased[2]


@pytest.mark.slow
def test_a_file_that_names_another_version_is_refused(tmp_path):
    env = beside(tmp_path / "site", "1.0")
    for version, code in (("1.0", 0), ("0.9", 2)):
        path = tmp_path / f"{version}.json"
        path.write_text(json.dumps({**STOPS, "plugins": {"plugin-example": version}}))
        done = subprocess.run(
            [sys.executable, "-m", "conductor", "validate", str(path)],
            env=env,
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
        assert done.returncode == code, done.stdout + done.stderr
    line = "plugins.plugin-example: given 0.9, installed is 1.0; install that version"
    assert line in " ".join((done.stdout + done.stderr).split())
