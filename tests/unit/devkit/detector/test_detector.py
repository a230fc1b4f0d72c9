"""devkit.detector.detector: the same for any batch and thread count; bad files."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import onnx
import pytest
from darknet_oracle import forward, random_weights
from onnx import TensorProto, helper

from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import ARCHITECTURES, architecture_network
from devkit.detector.decode import Selection, decode
from devkit.detector.description import (
    METADATA_KEY,
    BoxHead,
    DetectorDescription,
    GridHead,
    read_description,
)
from devkit.detector.detector import MODEL_BYTES_MAX, Detector, ModelError
from twin.base.errors import UsageError

NAMES = ["car", "truck", "pedestrian", "traffic_sign"]


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Name -> (file, network, weights) of the four architectures, narrow, random weights."""
    folder = tmp_path_factory.mktemp("models")
    found = {}
    for name in ARCHITECTURES:
        network = architecture_network(f"{name}-w25", classes=4, width=160, height=96)
        weights = random_weights(network, 11)
        onnx.save(write_onnx(network, weights, NAMES), folder / f"{name}.onnx")
        found[name] = (folder / f"{name}.onnx", network, weights)
    return found


@pytest.fixture
def threads():
    before = cv2.getNumThreads()
    yield cv2.setNumThreads
    cv2.setNumThreads(before)


def pictures(count: int, width: int = 320, height: int = 180) -> np.ndarray:
    rng = np.random.default_rng(count)
    small = rng.integers(0, 256, (count, 6, 10, 3), dtype=np.uint8)
    return np.stack([cv2.resize(image, (width, height)) for image in small])


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("runtime", ["opencv", "onnxruntime"])
def test_equal_for_any_batch_and_thread_count(models, threads, name, runtime):
    images = pictures(17)
    selection = Selection(confidence_min=0.05)
    threads(1)
    detector = Detector(models[name][0], selection, runtime=runtime)
    raw = detector.raw(images)
    expected = detector.detect(images)
    assert len(expected.image) > 50
    for count, batches in ((1, (1, 3, 16, 17)), (2, (3, 17))):
        threads(count)
        detector = Detector(models[name][0], selection, runtime=runtime)
        for batch in batches:
            for first in range(0, 17, batch):
                part = detector.raw(images[first : first + batch])
                for head, array in part.items():
                    assert np.array_equal(array, raw[head][first : first + batch])
            found = detector.detect(images[-batch:])
            for index in range(batch):
                assert found.of(index) == expected.of(17 - batch + index)


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("runtime", ["opencv", "onnxruntime"])
def test_boxes_are_those_of_the_numpy_network(models, name, runtime):
    path, network, weights = models[name]
    detector = Detector(path, Selection(confidence_min=0.2), runtime=runtime)
    images = pictures(2, width=160, height=96)
    expected = forward(network, weights, images.transpose(0, 3, 1, 2) / np.float32(255))
    heads = {f"head_{n}": expected[head.index] for n, head in enumerate(network.heads())}
    oracle = decode(heads, detector.description, [(160, 96)] * 2, Selection(confidence_min=0.2))
    found = detector.detect(images)
    both = sorted(set(found.place) & set(oracle.place))
    assert len(both) > 0.95 * max(len(set(found.place)), len(set(oracle.place)))
    for side in (found, oracle):
        assert len(side.image) > 0
    raw = detector.raw(images)
    for head, array in heads.items():
        assert np.allclose(raw[head], array, atol=1e-3 * array.std())


def test_images_are_stretched_rgb_and_scaled(models):
    path, network, weights = models["yolov2-tiny"]
    detector = Detector(path)
    image = np.zeros((48, 320, 3), np.uint8)
    image[..., 0] = 255
    images = np.zeros((1, 3, 96, 160), np.float32)
    images[:, 0] = 1.0
    expected = forward(network, weights, images)[-1]
    assert np.allclose(detector.raw(image[None])["head_0"], expected, atol=1e-3)


def test_no_images_give_no_boxes(models):
    found = Detector(models["yolov3-tiny"][0]).detect([])
    assert len(found.image) == 0
    assert found.of(0) == []


@pytest.mark.parametrize("shape", [(90, 160), (90, 160, 4), (1, 90, 160, 3)])
def test_an_image_of_another_shape_is_refused(models, shape):
    detector = Detector(models["yolov3-tiny"][0])
    with pytest.raises(ValueError, match=r"expected uint8 \[H, W, 3\]"):
        detector.detect([np.zeros(shape, np.uint8)])
    with pytest.raises(ValueError, match="given float32"):
        detector.detect([np.zeros((90, 160, 3), np.float32)])


# --- bad files ----------------------------------------------------------------------------------


def refused(path, description=None, runtime="opencv") -> str:
    with pytest.raises(ModelError) as caught:
        Detector(path, description=description, runtime=runtime)
    line = str(caught.value)
    assert line.startswith(str(path))
    assert "\n" not in line
    return line


def test_files_that_are_no_model(models, tmp_path):
    path = tmp_path / "x.onnx"
    assert "No such file" in refused(path)
    assert "Is a directory" in refused(tmp_path)
    whole = models["yolov3-tiny"][0].read_bytes()
    for data in (b"", b"no model", b"\x00" * 100, whole[: len(whole) // 2], whole[:-1]):
        path.write_bytes(data)
        assert "not an ONNX file, or damaged" in refused(path)
    with path.open("wb") as file:
        file.truncate(MODEL_BYTES_MAX + 1)  # takes no room
    assert f"at most {MODEL_BYTES_MAX} are read" in refused(path)


def changed(models, tmp_path, change) -> object:
    """The smallest model after ``change(model)``."""
    model = onnx.load(models["yolov3-tiny"][0])
    change(model)
    onnx.save(model, tmp_path / "x.onnx")
    return tmp_path / "x.onnx"


def without_metadata(model):
    del model.metadata_props[:]


def described(model, **changes):
    description = DetectorDescription(
        width=160,
        height=96,
        names=NAMES,
        heads=[
            GridHead("head_0", [(81, 82), (135, 169), (344, 319)]),
            GridHead("head_1", [(10, 14), (23, 27), (37, 58)]),
        ],
    )
    text = msgspec.structs.replace(description, **changes).encode()
    helper.set_model_props(model, {METADATA_KEY: text})


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (without_metadata, "no metadata 'drivetwin.detector', so width, height, names and heads"),
        (
            lambda m: helper.set_model_props(m, {METADATA_KEY: "{"}),
            "metadata 'drivetwin.detector': not JSON",
        ),
        (
            lambda m: helper.set_model_props(m, {METADATA_KEY: "{}"}),
            "metadata 'drivetwin.detector': width: missing",
        ),
        (
            lambda m: described(m, width=320, height=192),
            "input 'images' is [batch, 3, 96, 160], expected [batch, 3, 192, 320]",
        ),
        (
            lambda m: described(m, heads=[GridHead("head", [(8, 8)])]),
            "no output 'head'; did you mean 'head_",
        ),
        (
            lambda m: described(m, names=["car"]),
            "output 'head_0' is [1, 27, 3, 5], expected [batch, 18, rows, columns]",
        ),
    ],
)
def test_models_that_do_not_fit_their_description(models, tmp_path, change, line):
    assert line in refused(changed(models, tmp_path, change))


def one_node(tmp_path, kind, inputs, domain="", **attributes):
    """A model of one node, described as a detector with one head."""
    values = [helper.make_tensor_value_info(name, type_, shape) for name, type_, shape in inputs]
    graph = helper.make_graph(
        [helper.make_node(kind, [i[0] for i in inputs], ["head"], domain=domain, **attributes)],
        "g",
        values,
        [helper.make_tensor_value_info("head", inputs[0][1], ["n", None, None, None])],
    )
    opsets = [helper.make_opsetid("", 13)] + [helper.make_opsetid(domain, 1)] * bool(domain)
    model = helper.make_model(graph, opset_imports=opsets, ir_version=8)
    described(model, width=8, height=8, names=["a"], heads=[GridHead("head", [(8, 8)])])
    onnx.save(model, tmp_path / "x.onnx")
    return tmp_path / "x.onnx"


def test_an_operator_that_opencv_does_not_have_is_named(tmp_path):
    images = ("images", TensorProto.FLOAT, ["n", 3, 8, 8])
    path = one_node(tmp_path, "Wobble", [images], domain="strange.ops")
    assert "OpenCV cannot run it: operator Wobble: it has no such operator" in refused(path)
    line = refused(path, runtime="onnxruntime")
    assert "ONNX Runtime cannot run it: operator Wobble: " in line
    assert "runtime 'tensorrt', allowed: opencv, onnxruntime" in refused(path, runtime="tensorrt")


def test_inputs_that_are_no_images(tmp_path):
    images = ("images", TensorProto.FLOAT, ["n", 3, 8, 8])
    grey = ("images", TensorProto.FLOAT, ["n", 1, 8, 8])
    whole = ("images", TensorProto.INT64, ["n", 3, 8, 8])
    flat = ("images", TensorProto.FLOAT, ["n", 192])
    more = ("more", TensorProto.FLOAT, ["n", 3, 8, 8])
    assert "is [n, 1, 8, 8], expected [batch, 3, 8, 8]" in refused(
        one_node(tmp_path, "Abs", [grey])
    )
    assert "is [n, 192], expected [batch, 3, 8, 8]" in refused(one_node(tmp_path, "Abs", [flat]))
    assert "is not float32" in refused(one_node(tmp_path, "Abs", [whole]))
    assert "inputs images, more, expected one" in refused(one_node(tmp_path, "Add", [images, more]))


# --- a model of the user's ----------------------------------------------------------------------


@pytest.mark.parametrize("batch", ["n", 1, 2])
def test_a_plain_model_is_described_by_its_user(tmp_path, batch):
    path = one_node(tmp_path, "Concat", [("images", TensorProto.FLOAT, [batch, 3, 8, 8])], axis=1)
    model = onnx.load(path)
    without_metadata(model)
    model.graph.node[0].input.append("images")  # six channels: one anchor, one class
    onnx.save(model, path)
    (tmp_path / "x.json").write_text(
        '{"width": 8, "height": 8, "names": ["thing"], "channel_order": "bgr", "heads":'
        ' [{"kind": "grid", "output": "head", "anchors_px": [[8, 8]], "scores": "softmax"}]}'
    )
    detector = Detector(path, description=read_description(tmp_path / "x.json"))
    images = np.random.default_rng(1).integers(0, 256, (5, 8, 8, 3), dtype=np.uint8)
    raw = detector.raw(images)["head"]
    planes = images[..., ::-1].transpose(0, 3, 1, 2).astype(np.float32) / 255
    assert np.allclose(raw, np.concatenate([planes, planes], axis=1))
    assert {d.label for d in detector.detect(images).of(4)} == {"thing"}


def test_a_plain_model_of_finished_boxes(tmp_path):
    path = one_node(tmp_path, "Reshape", [("images", TensorProto.FLOAT, ["n", 3, 8, 8])])
    model = onnx.load(path)
    without_metadata(model)
    model.graph.initializer.append(helper.make_tensor("shape", TensorProto.INT64, [3], [-1, 6, 32]))
    model.graph.node[0].input.append("shape")
    onnx.save(model, path)
    head = BoxHead("head", "columns")
    image = np.full((1, 8, 8, 3), 255, np.uint8)
    found = Detector(path, description=DetectorDescription(8, 8, ["a"], [head])).detect(image)
    assert [(d.label, d.confidence) for d in found.of(0)] == [("a", 1.0)]
    for wrong, line in (
        (BoxHead("head"), "is [1, 6, 32], expected [batch, boxes, 6]: 4 for the box + objectness"),
        (
            BoxHead("head", "columns", False),
            "expected [batch, 5, boxes]: 4 for the box + 1 classes",
        ),
        (GridHead("head", [(8, 8)]), "expected [batch, 6, rows, columns]: 1 anchors x (5 + 1"),
    ):
        assert line in refused(path, DetectorDescription(8, 8, ["a"], [wrong]))


def test_a_description_with_mistakes(tmp_path):
    path = tmp_path / "x.json"
    for text, line in (
        ("[", "x.json: not JSON"),
        ("{}", "x.json: width: missing"),
        ('{"hight": 3}', "x.json: hight: unknown key; did you mean 'height'"),
    ):
        path.write_text(text)
        with pytest.raises(UsageError, match=line):
            read_description(path)
    path.write_bytes(b"\xff{}")
    with pytest.raises(UsageError, match=r"x\.json: not UTF-8 text \(byte 0\)"):
        read_description(path)
    with pytest.raises(UsageError, match="No such file"):
        read_description(tmp_path / "none.json")
