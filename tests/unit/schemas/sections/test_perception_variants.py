"""Perception variants of type network: keys, relative paths, digests, rig keys."""

from __future__ import annotations

import shutil

import msgspec
import pytest
from case_changes import changed

from conductor.core.case_table import pack, unpack
from conductor.run.source import check, load
from schemas.identity import campaign_digest, case_digest, rig_key
from schemas.plan import parse_plan
from schemas.sections.perception import NetworkPerception, file_fields
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease
from schemas.wire.expected import EXPECTED_MAX, expected_of
from twin.base.errors import UsageError

CAMPAIGN = """
campaign: own
camera: {width: 32, height: 18}
autonomy:
  perception:
    mine: {type: network, model: nets/mine.onnx, description: nets/mine.json}
    dark: {type: network, model: nets/a.cfg, weights: nets/a.weights, names: nets/a.names}
    truth: {type: ground_truth}
matrix: {model: [mine, dark, truth]}
"""


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "here"
    (folder / "nets").mkdir(parents=True)
    for name in ("mine.onnx", "mine.json", "a.cfg", "a.weights", "a.names"):
        (folder / "nets" / name).write_text(name)
    path = folder / "own.yaml"
    path.write_text(CAMPAIGN)
    return path


def test_paths_are_those_beside_the_campaign_file(campaign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loaded = load("here/own.yaml")
    mine, dark, truth = loaded.cases
    nets = campaign.parent / "nets"
    assert mine.variation.perception.model == str(nets / "mine.onnx")
    assert set(mine.variation.files) == {str(nets / "mine.onnx"), str(nets / "mine.json")}
    assert set(dark.variation.files) == {
        str(nets / name) for name in ("a.cfg", "a.weights", "a.names")
    }
    assert truth.variation.files == {}
    assert {*mine.rig.files} == {*mine.rig.models}


def test_variants_share_a_rig_whatever_their_files(campaign):
    assert len({rig_key(case) for case in load(str(campaign)).cases}) == 1


def test_another_content_is_another_campaign(campaign):
    before = load(str(campaign))
    (campaign.parent / "nets" / "a.weights").write_text("other")
    after = load(str(campaign))
    digests = [campaign_digest(plan.campaign, plan.cases) for plan in (before, after)]
    assert digests[0] != digests[1]
    pairs = zip(before.cases, after.cases, strict=True)
    changed = [case_digest(a) != case_digest(b) for a, b in pairs]
    assert changed == [False, True, False]


def test_they_travel(campaign):
    cases = load(str(campaign)).cases
    assert unpack(pack(cases)) == cases
    lease = Lease(token=1, attempt=1, out="/x", case=cases[0])
    assert decode(encode(lease), Lease) == lease


def test_missing_files_are_named_with_their_key(campaign):
    shutil.rmtree(campaign.parent / "nets")
    with pytest.raises(UsageError) as caught:
        load(str(campaign))
    lines = str(caught.value).splitlines()
    assert len(lines) == 5
    nets = campaign.parent / "nets"
    assert f"autonomy.perception.mine.model: {nets}/mine.onnx: no such file" in lines[0]
    assert f"autonomy.perception.dark.weights: {nets}/a.weights: no such file" in lines[3]


def test_variants_that_no_case_uses_may_lack_their_files(campaign):
    shutil.rmtree(campaign.parent / "nets")
    campaign.write_text(CAMPAIGN.replace("[mine, dark, truth]", "[truth]"))
    assert len(load(str(campaign)).cases) == 1


@pytest.mark.parametrize(
    ("variant", "line"),
    [
        ({}, "model: missing; text needed"),
        ({"model": ""}, "model: given ''"),
        ({"model": "a.cfg"}, "weights: missing; a Darknet .cfg needs its .weights"),
        ({"model": "a.onnx", "weights": "b"}, "belong to a Darknet .cfg, not to an ONNX file"),
        ({"model": "a.onnx", "names": "b"}, "belong to a Darknet .cfg, not to an ONNX file"),
        (
            {"model": "yolov3", "names": "b"},
            "names belong to a Darknet network, which needs its weights",
        ),
        (
            {"model": "yolov3", "weights": "b", "description": "c"},
            "description belongs to an ONNX file",
        ),
        ({"model": "a", "confidence_min": 0}, "confidence_min: given 0, allowed: a number > 0"),
        ({"model": "a", "overlap_max": 1.5}, "overlap_max: given 1.5"),
        ({"model": "a", "order": "size"}, "order: given 'size', allowed: confidence, place"),
        ({"model": "a", "runtime": "tensorrt"}, "runtime: given 'tensorrt', allowed: auto"),
        ({"model": "a", "contrast_min": 0.1}, "contrast_min: unknown key"),
        ({"modle": "a"}, "did you mean 'model'?"),
    ],
)
def test_mistakes(variant, line):
    perception = {"a": {"type": "network", **variant}}
    data = {"campaign": "c", "autonomy": {"perception": perception}, "matrix": {"model": ["a"]}}
    campaign, mistakes = check(data)
    assert campaign is None
    assert any(line in mistake.line("c.yaml") for mistake in mistakes), mistakes


def test_which_keys_name_files():
    assert file_fields(NetworkPerception(model="yolov3-w25")) == {}
    assert file_fields(NetworkPerception(model="yolov3", weights="w")) == {"weights": "w"}
    assert file_fields(NetworkPerception(model="x/y")) == {"model": "x/y"}


def test_a_stack_is_told_of_each_variant_once():
    data = {
        "campaign": "c",
        "autonomy": {
            "perception": {
                "sharp": {"type": "ground_truth", "contrast_min": 0.1},
                "plain": {"type": "ground_truth"},
            }
        },
        "matrix": {"model": ["sharp", "plain"], "weather": ["clear", "heavy_rain"]},
    }
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    cases = plan.cases
    expected = expected_of(cases, "cpu")
    assert [each.perception.contrast_min for each in expected] == [0.1, 0.05]
    assert {each.width for each in expected} == {plan.campaign.camera.width}
    many = [
        changed(
            cases[0],
            perception=msgspec.structs.replace(cases[0].variation.perception, pixels_min=count),
        )
        for count in range(1, 2 * EXPECTED_MAX)
    ]
    assert len(expected_of(many, "cpu")) == EXPECTED_MAX
