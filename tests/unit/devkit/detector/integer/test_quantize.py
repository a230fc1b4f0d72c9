"""``devkit quantize``: how near an integer network is to the float one, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from integer_networks import pictures, write_float
from onnx import TensorProto, helper, numpy_helper
from typer.testing import CliRunner

from devkit.cli import app
from devkit.darknet.variant import ARCHITECTURES
from devkit.detector.description import METADATA_KEY, DetectorDescription, GridHead
from devkit.detector.detector import Detector
from devkit.detector.integer.levels import factor_of, kernel_levels, scale_of
from devkit.detector.integer.network_file import read_network
from devkit.detector.model_files import shipped_integer_models, shipped_models
from twin.base.errors import UsageError


def run(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=True)


def refusal(*words: object) -> str:
    result = run(*words)
    assert isinstance(result.exception, UsageError), (result.output, result.exception)
    line = str(result.exception)
    assert "\n" not in line
    return line


@pytest.fixture
def folder(tmp_path) -> Path:
    """Pictures to calibrate with."""
    place = tmp_path / "pictures"
    place.mkdir()
    for number, picture in enumerate(pictures(6, seed=21)):
        cv2.imwrite(str(place / f"{number}.png"), picture[..., ::-1])
    return place


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_heads_are_near_those_of_the_float_network(tmp_path, folder, name):
    path, out = write_float(tmp_path / f"{name}.onnx", name), tmp_path / "n.integer"
    done = run("quantize", path, "-o", out, "--calibrate", folder, "--output", "json")
    assert done.exit_code == 0, done.exception
    told = json.loads(done.stdout)
    assert told["bytes"] == out.stat().st_size < path.stat().st_size / 3
    assert "6 pictures" in told["origin"]
    images = pictures(4, seed=3)
    integer, exact = Detector(out).raw(images), Detector(path).raw(images)
    for output, values in exact.items():
        error = np.sqrt(np.square(integer[output] - values).mean())
        assert error < 0.15 * values.std(), output


def test_the_same_pictures_give_the_same_file(tmp_path, folder):
    path = write_float(tmp_path / "a.onnx", "yolov3-tiny")
    for out in ("a.integer", "b.integer"):
        assert run("quantize", path, "-o", tmp_path / out, "--calibrate", folder).exit_code == 0
    assert (tmp_path / "a.integer").read_bytes() == (tmp_path / "b.integer").read_bytes()


def test_shipped_integer_networks_are_made_of_the_shipped_ones():
    made = shipped_integer_models()
    assert set(made) == {f"{name}-int8" for name in shipped_models()}
    for name, path in made.items():
        network, description, _ = read_network(path)
        source = shipped_models()[name.removesuffix("-int8")]
        assert network.origin.startswith(source.name)
        assert description == Detector(source).description


def model(tmp_path, *nodes, kernels=None, **constants) -> Path:
    """A network of one convolution of 1x1, 6 channels, and what follows it."""
    if kernels is None:
        kernels = np.ones((6, 3, 1, 1), np.float32)
    arrays = {"kernels": kernels, **constants}
    graph = helper.make_graph(
        [helper.make_node("Conv", ["images", "kernels"], ["first"]), *nodes],
        "n",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, ["n", 3, 8, 8])],
        [helper.make_tensor_value_info("head", TensorProto.FLOAT, ["n", 6, None, None])],
        [numpy_helper.from_array(array, name) for name, array in arrays.items()],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    description = DetectorDescription(8, 8, ["car"], [GridHead("head", [(4.0, 4.0)])])
    helper.set_model_props(made, {METADATA_KEY: description.encode()})
    onnx.save(made, tmp_path / "m.onnx")
    return tmp_path / "m.onnx"


IDENTITY = helper.make_node("Identity", ["first"], ["head"])
SECOND = helper.make_node("Conv", ["a", "second"], ["head"])
EYE = np.eye(6, dtype=np.float32).reshape(6, 6, 1, 1)


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ([helper.make_node("Sigmoid", ["first"], ["a"]), SECOND], "operator Sigmoid (makes 'a')"),
        ([helper.make_node("Sigmoid", ["first"], ["head"])], "operator Sigmoid (makes 'head')"),
        ([helper.make_node("Mul", ["first", "first"], ["a"]), SECOND], "operator Mul"),
        ([helper.make_node("Relu", ["first"], ["head"])], "output 'head' is not what a Conv makes"),
        (
            [helper.make_node("LeakyRelu", ["first"], ["a"], alpha=2.0), SECOND],
            "operator LeakyRelu with a slope of 2",
        ),
        (
            [helper.make_node("AveragePool", ["first"], ["a"], kernel_shape=[2, 2]), SECOND],
            "operator AveragePool",
        ),
        (
            [helper.make_node("MaxPool", ["first"], ["a"], kernel_shape=[2, 3]), SECOND],
            "operator MaxPool that is not square",
        ),
        (
            [
                helper.make_node("MaxPool", ["first"], ["a"], kernel_shape=[2, 2], ceil_mode=1),
                SECOND,
            ],
            "operator MaxPool with indices or ceil_mode",
        ),
        ([helper.make_node("Concat", ["first", "first"], ["a"], axis=2), SECOND], "Concat"),
        ([helper.make_node("Add", ["first", "second"], ["a"]), SECOND], "Add of a constant"),
        (
            [IDENTITY, helper.make_node("Conv", ["head", "second"], ["more"])],
            "read by other layers, too",
        ),
    ],
)
def test_what_cannot_be_whole_numbers_is_named(tmp_path, folder, nodes, words):
    path = model(tmp_path, *nodes, second=EYE)
    line = refusal("quantize", path, "-o", tmp_path / "n.integer", "--calibrate", folder)
    assert line.startswith(str(path))
    assert words in line
    assert not (tmp_path / "n.integer").exists()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(tmp_path, folder, value):
    kernels = np.ones((6, 3, 1, 1), np.float32)
    kernels[2, 1] = value
    path = model(tmp_path, IDENTITY, kernels=kernels)
    line = refusal("quantize", path, "-o", tmp_path / "n.integer", "--calibrate", folder)
    assert "'kernels' has numbers that are not finite" in line


def test_maps_that_overflow_are_refused(tmp_path, folder):
    huge = np.full((6, 3, 1, 1), 3e38, np.float32)
    path = model(
        tmp_path,
        helper.make_node("Conv", ["first", "second"], ["a"]),
        helper.make_node("Conv", ["a", "second"], ["head"]),
        kernels=huge,
        second=EYE,
    )
    line = refusal("quantize", path, "-o", tmp_path / "n.integer", "--calibrate", folder)
    assert "is not finite for a picture" in line


def test_a_layer_of_zeros_has_the_head_of_its_bias(tmp_path, folder):
    path = model(tmp_path, IDENTITY, kernels=np.zeros((6, 3, 1, 1), np.float32))
    assert run("quantize", path, "-o", tmp_path / "n.integer", "--calibrate", folder).exit_code == 0
    assert not Detector(tmp_path / "n.integer").raw(pictures(1, 8, 8))["head"].any()


def test_calibration_without_a_picture_is_refused(tmp_path):
    path = model(tmp_path, IDENTITY)
    words = ("quantize", path, "-o", tmp_path / "n.integer", "--calibrate")
    assert "No such file" in refusal(*words, tmp_path / "gone")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "no picture" in refusal(*words, empty)
    (empty / "a.png").write_bytes(b"no picture")
    assert "a.png: no picture that can be read" in refusal(*words, empty)
    (empty / "dataset.yaml").write_text("format: 1\n")
    assert "not what 'twin dataset' writes" in refusal(*words, empty)


def test_wrong_files_are_one_line(tmp_path, folder):
    path = model(tmp_path, IDENTITY)
    out = tmp_path / "n.integer"
    assert "expected a name that ends in .integer" in refusal(
        "quantize", path, "-o", tmp_path / "n.onnx", "--calibrate", folder
    )
    assert "give --score DATASET" in refusal(
        "quantize", path, "-o", out, "--calibrate", folder, "--check"
    )
    assert "no dataset" in refusal(
        "quantize", path, "-o", out, "--calibrate", folder, "--score", folder
    )
    assert "is an integer network already" in refusal(
        "quantize", out, "-o", out, "--calibrate", folder
    )
    assert "No such file" in refusal(
        "quantize", path, "-o", tmp_path / "no" / "n.integer", "--calibrate", folder
    )
    assert "no such model is shipped" in refusal(
        "quantize", "yolov9", "-o", out, "--calibrate", folder
    )


def test_factors_are_within_half_a_unit_of_their_number():
    rng = np.random.default_rng(1)
    for value in [*np.exp2(rng.uniform(-30, 29, 500)).tolist(), 1.0, 0.5, 1.0 - 2**-40, 2.0**29]:
        factor, shift = factor_of(value)
        assert 2**30 <= factor < 2**31
        assert 1 <= shift <= 62
        assert abs(factor / 2.0**shift - value) <= 0.5001 * 2.0**-shift * 2
    assert factor_of(2.0**-80) == (0, 62)
    with pytest.raises(ValueError, match="a factor of"):
        factor_of(2.0**31)


def test_scales_hold_zero_exactly_and_clip_what_is_rare():
    rng = np.random.default_rng(2)
    values = np.concatenate([rng.normal(0, 1, 100_000), [900.0]])
    scale = scale_of(values[:-1], values.min(), 900.0)
    assert -128 <= scale.zero <= 127
    assert scale.step * 255 < 400
    for least, largest in ((0.0, 5.0), (-5.0, 0.0), (2.0, 5.0), (0.0, 0.0)):
        scale = scale_of(np.array([least, largest]), least, largest)
        low, high = ((level - scale.zero) * scale.step for level in (-128, 127))
        assert low <= 0.0 <= high


def test_kernels_use_all_levels_and_have_no_minus_128():
    kernels = np.random.default_rng(3).normal(0, 1, (5, 4, 3, 3))
    kernels[2] = 0.0
    levels, scales = kernel_levels(kernels)
    assert np.abs(levels).max(axis=(1, 2, 3)).tolist() == [127, 127, 0, 127, 127]
    assert np.abs(levels * scales[:, None, None, None] - kernels).max() <= scales.max() / 2 + 1e-12
