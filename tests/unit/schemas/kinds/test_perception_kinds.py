"""Perception variants are kinds: what the code asks of one is in its declaration."""

import json
import subprocess
import sys

import msgspec
import pytest
from plugin_site import ROOT, beside

from schemas.identity import is_told_truth
from schemas.kinds.perception import perception_kind, perception_kinds
from schemas.plan import parse_plan
from schemas.sections.perception import NetworkPerception, file_fields

CODE = """
import json, sys
from devkit.perception import build_perception
from schemas.identity import is_told_truth
from schemas.plan import parse_plan
found = []
for models in json.load(sys.stdin):
    variants = {"plain": {"type": "ground_truth"}}
    if "wide" in models:
        variants["wide"] = {"type": "tunnel", "share": 0.5}
    plan, mistakes = parse_plan(
        {"campaign": "c", "autonomy": {"perception": variants}, "matrix": {"model": models}}
    )
    if plan is None:
        found.append([mistake.line("c.yaml") for mistake in mistakes])
        continue
    seen = [case.variation.perception for case in plan.cases]
    built = [type(build_perception(each)).__name__ for each in seen]
    found.append([plan.campaign.plugins, [is_told_truth(case) for case in plan.cases], built])
print(json.dumps(found))
"""


def said(env, given):
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env=env,
        cwd=ROOT,
        input=json.dumps(given),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_variant_of_others_is_built_by_its_declaration(tmp_path):
    plain, both = said(beside(tmp_path, "1.0"), [["plain"], ["plain", "wide"]])
    assert plain == [{}, [True], ["ContrastPerception"]]
    assert both == [{"plugin-example": "1.0"}, [True] * 2, ["ContrastPerception", "Tunnel"]]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('tag="tunnel"', 'tag="funnel"', "plugin-example 1.0: perception 'tunnel': its config"),
        ("KIND = ", "OTHER = ", "plugin-example 1.0: entry point 'tunnel' of drivetwin.perception"),
    ],
)
def test_a_variant_that_cannot_be_used_says_why_to_who_names_it(tmp_path, old, new, reason):
    env = beside(tmp_path, "1.0")
    copy = tmp_path / "plugin_example"
    copy.mkdir()
    for file in (ROOT / "tests/plugin_example/plugin_example").glob("*.py"):
        (copy / file.name).write_text(file.read_text().replace(old, new))
    (lines,) = said(env, [["plain", "wide"]])
    assert len(lines) == 1
    assert reason in lines[0]


@pytest.mark.slow
def test_what_a_variant_of_others_loads_is_tried_before_any_case_is_leased(tmp_path):
    env = beside(tmp_path, "1.0") | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    copy = tmp_path / "plugin_example"
    copy.mkdir()
    changes = {
        'name="tunnel"': 'name="tunnel", loaded="share"',
        "        width_px =": "        {}['share']\n        width_px =",
    }
    for file in (ROOT / "tests/plugin_example/plugin_example").glob("*.py"):
        text = file.read_text()
        for old, new in changes.items():
            text = text.replace(old, new)
        (copy / file.name).write_text(text)
    campaign = tmp_path / "c.yaml"
    campaign.write_text(
        "campaign: c\nautonomy: {perception: {wide: {type: tunnel}, plain: {type: ground_truth}}}\n"
        "matrix: {model: [wide, plain]}\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "conductor", "validate", str(campaign)],
        env=env,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.strip().endswith(
        "c.yaml: autonomy.perception.wide: plugin-example 1.0: KeyError: 'share'"
    )


def test_an_entry_point_called_like_a_shipped_variant_disturbs_nobody(tmp_path):
    env = beside(tmp_path, "1.0")
    points = next(tmp_path.glob("*.dist-info")) / "entry_points.txt"
    points.write_text(points.read_text().replace("tunnel = plugin", "ground_truth = no_plugin"))
    assert said(env, [["plain"]]) == [[{}, [True], ["ContrastPerception"]]]


def test_who_is_told_the_truth_stands_in_the_declarations():
    told = {"ground_truth": True, "network": False}
    assert {kind.name: kind.told_truth for kind in perception_kinds().declared} == told
    variants = {"a": {"type": "ground_truth"}, "b": {"type": "network", "model": "yolov3-w25"}}
    data = {"campaign": "c", "autonomy": {"perception": variants}, "matrix": {"model": ["a", "b"]}}
    plan, _ = parse_plan(data)
    assert [is_told_truth(case) for case in plan.cases] == [True, False]
    data["autonomy"] |= {"tell": ["truth"]}
    plan, _ = parse_plan(data)
    assert [is_told_truth(case) for case in plan.cases] == [True, True]


def test_files_of_a_variant_are_those_that_its_declaration_names():
    assert file_fields(NetworkPerception(model="yolov3-w25")) == {}
    found = file_fields(NetworkPerception(model="/a/b.cfg", weights="/a/b.weights"))
    assert found == {"model": "/a/b.cfg", "weights": "/a/b.weights"}


def test_what_is_no_variant_is_refused():
    with pytest.raises(ValueError, match="allowed: ground_truth, network"):
        perception_kind(msgspec.defstruct("Other", [])())
