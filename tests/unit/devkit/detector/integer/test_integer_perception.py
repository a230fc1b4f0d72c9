"""Integer networks as perception variants: what they are told, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from integer_networks import pictures, write_quantized
from typer.testing import CliRunner

import devkit
from devkit.cli import app
from devkit.detector.model_files import open_detector, shipped_integer_models
from devkit.images import Images
from devkit.perception import Setting, build_perception
from schemas.files.assets import file_digest
from schemas.kinds.perception import perception_kind
from schemas.sections.perception import NetworkPerception, file_fields
from twin.base.errors import RefusedError


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    return write_quantized(tmp_path_factory.mktemp("models"), "yolov3-tiny")


def variant(model, **changes) -> NetworkPerception:
    return NetworkPerception(model=str(model), **{"confidence_min": 0.05, **changes})


def test_what_a_slot_is_told_does_not_depend_on_the_others(model):
    perception = build_perception(variant(model), Setting(size_px=(160, 96)))
    assert perception.runtime == "integer cpu"
    images = pictures(9, seed=4)
    whole = perception.detect(Images(images, range(9)), [None] * 9)
    assert sum(map(len, whole)) > 20
    for rows in ([8, 0, 3], [5], [1, 1, 2, 7]):
        assert perception.detect(Images(images, rows), [None] * len(rows)) == [
            whole[row] for row in rows
        ]


def test_selection_is_that_of_the_variant(model):
    image = Images(pictures(1, seed=4), [0])
    (many,) = build_perception(variant(model), Setting()).detect(image, [None])
    least = many[20].confidence
    strict = variant(model, confidence_min=least)
    (few,) = build_perception(strict, Setting()).detect(image, [None])
    assert 0 < len(few) < len(many)
    assert min(one.confidence for one in few) >= least


def test_the_file_belongs_to_the_case(model, tmp_path):
    path = tmp_path / "n.integer"
    path.write_bytes(model.read_bytes())
    given = variant(path)
    assert file_fields(given) == {"model": str(path)}
    files = {str(path): file_digest(path)}
    assert open_detector(given, files, "cpu").runtime == "integer cpu"
    path.write_bytes(model.read_bytes() + b"\0")
    with pytest.raises(RefusedError, match="not the file that the campaign was submitted with"):
        open_detector(given, files, "cpu")


@pytest.mark.parametrize("name", sorted(shipped_integer_models()))
def test_shipped_names_are_files_of_the_package(name):
    shipped = perception_kind(variant(name)).shipped(variant(name))
    (path,) = shipped.values()
    assert Path(devkit.__file__).parents[1] / path == shipped_integer_models()[name]
    assert open_detector(variant(name), {}, "cpu").path == shipped_integer_models()[name]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"runtime": "opencv"}, "runtime: given opencv; an integer network runs in kernels"),
        ({"runtime": "onnxruntime"}, "leave the key out"),
        ({"weights": "a.weights"}, "weights: not for an integer network"),
        ({"description": "a.json"}, "description: not for an integer network"),
    ],
)
@pytest.mark.parametrize("name", ["nets/a.integer", "yolov3-w25-int8"])
def test_keys_that_nothing_would_look_at_are_refused(name, changes, words):
    data = json.dumps({"type": "network", "model": name, **changes})
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.json.decode(data, type=NetworkPerception)


def test_conductors_are_told_what_is_wrong_before_a_case_is_leased(model, tmp_path):
    broken = tmp_path / "broken.integer"
    broken.write_bytes(model.read_bytes()[:-7])
    asked = {name: variant(path) for name, path in (("good", model), ("bad", broken))}
    done = CliRunner().invoke(app, ["check-models"], input=msgspec.json.encode(asked))
    answer = json.loads(done.stdout)
    assert answer["good"] == {"error": "", "runtime": "integer cpu"}
    assert answer["bad"]["error"].startswith(f"{broken}: not an integer network, or damaged")


def test_models_are_listed_with_the_cards_of_their_float_networks():
    listed = CliRunner().invoke(app, ["models"]).stdout.splitlines()
    for name in shipped_integer_models():
        (line,) = [one for one in listed if one.startswith(f"{name} ")]
        assert line.endswith(f"{name.removesuffix('-int8')}.md")
