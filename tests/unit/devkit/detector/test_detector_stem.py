"""devkit.detector.stem and devkit.detector.thin: the first layers of a network, cut off and
computed by kernels, here on the CPU and beside ONNX Runtime."""

from __future__ import annotations

import numpy as np
import onnx
import onnxruntime
import pytest
import warp as wp
from onnx import TensorProto, helper, numpy_helper

from devkit.detector.model_files import shipped_models
from devkit.detector.stem import IN_MAX, OUT_MAX, cut
from devkit.detector.thin import ThinLayers
from twin.world.kernel_cache import prepare_kernels

LEAKY = {"alpha": 0.1}
HALVES = {"kernel_shape": [2, 2], "strides": [2, 2]}


def convolution(given: int, made: int, **changes) -> dict:
    """What :func:`network` needs for one layer."""
    how = {"kernel_shape": [3, 3], "pads": [1, 1, 1, 1], "strides": [1, 1]}
    layer = {"in": given, "out": made, "conv": how, "leaky": LEAKY, "pool": HALVES, "half": False}
    return {**layer, **{key: value for key, value in changes.items() if key != "conv"}} | {
        "conv": {k: v for k, v in {**how, **changes.get("conv", {})}.items() if v is not None}
    }


def network(*layers: dict, rows: int = 12, columns: int = 20, batch: int | str = "batch"):
    """An ONNX model of these layers, and a last convolution of 1x1 that is never cut off."""
    rng = np.random.default_rng(len(layers))
    nodes, tensors, name = [], [], "images"
    for index, layer in enumerate(layers):
        size = layer["conv"]["kernel_shape"][0]
        groups = layer["conv"].get("group", 1)
        kernels = rng.normal(size=(layer["out"], layer["in"] // groups, size, size))
        biases = rng.normal(size=layer["out"])
        kind = np.float16 if layer["half"] else np.float32
        tensors.append(numpy_helper.from_array(kernels.astype(kind), f"k{index}"))
        tensors.append(numpy_helper.from_array(biases.astype(np.float32), f"b{index}"))
        weights = f"k{index}"
        if layer["half"]:
            nodes.append(helper.make_node("Cast", [weights], [f"w{index}"], to=TensorProto.FLOAT))
            weights = f"w{index}"
        inputs = [name, weights, f"b{index}"]
        nodes.append(helper.make_node("Conv", inputs, [f"c{index}"], **layer["conv"]))
        name = f"c{index}"
        if layer["leaky"]:
            nodes.append(helper.make_node("LeakyRelu", [name], [f"l{index}"], **layer["leaky"]))
            name = f"l{index}"
        if layer["pool"]:
            nodes.append(helper.make_node("MaxPool", [name], [f"p{index}"], **layer["pool"]))
            name = f"p{index}"
    last = rng.normal(size=(5, layers[-1]["out"], 1, 1)).astype(np.float32)
    tensors.append(numpy_helper.from_array(last, "last"))
    nodes.append(helper.make_node("Conv", [name, "last"], ["heads"]))
    given = helper.make_tensor_value_info(
        "images", TensorProto.FLOAT, [batch, layers[0]["in"], rows, columns]
    )
    made = helper.make_tensor_value_info("heads", TensorProto.FLOAT, [batch, 5, None, None])
    graph = helper.make_graph(nodes, "network", [given], [made], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    return model


def answers(model, **inputs) -> list[np.ndarray]:
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(model.SerializeToString(), options).run(None, inputs)


def thin(layers, pictures: np.ndarray) -> np.ndarray:
    prepare_kernels()
    kernels = ThinLayers(layers, wp.array(pictures, device="cpu"), None)
    kernels.run()
    return kernels.out.numpy()


def largest_difference(model, pictures: np.ndarray, count: int) -> float:
    """Between the whole network and its first ``count`` layers by kernels, the rest by ONNX
    Runtime; relative to the largest value."""
    layers, rest, name = cut(model, "images")
    assert len(layers) == count
    onnx.checker.check_model(rest)
    found = answers(rest, **{name: thin(layers, pictures)})
    expected = answers(model, images=pictures)
    return max(
        float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, expected, strict=True)
    )


@pytest.mark.parametrize(("rows", "columns"), [(12, 20), (13, 21), (2, 2), (33, 6)])
@pytest.mark.parametrize(
    "layers",
    [
        [convolution(3, 4), convolution(4, 8, half=True)],
        [convolution(3, 8, pool=None), convolution(8, 16, pool=None, conv={"strides": [2, 2]})],
        [convolution(1, 1, leaky=None, pool=None)],
        [convolution(IN_MAX, OUT_MAX, leaky={"alpha": 0.0}, pool=None)],
        [convolution(3, 5, leaky={}, conv={"strides": [2, 2]}, pool=None)],
    ],
)
def test_kernels_and_the_rest_are_the_whole_network(layers, rows, columns):
    model = network(*layers, rows=rows, columns=columns)
    if any(layer["pool"] for layer in layers) and min(rows, columns) < 4:
        layers = layers[:1]
        model = network(*layers, rows=rows, columns=columns)
    rng = np.random.default_rng(rows)
    pictures = rng.random((3, layers[0]["in"], rows, columns), dtype=np.float32)
    assert largest_difference(model, pictures, len(layers)) < 2e-6


@pytest.mark.parametrize("name", sorted(shipped_models()))
def test_shipped_networks_begin_with_such_layers(name):
    model = onnx.load(shipped_models()[name])
    _, channels, rows, columns = (
        d.dim_value for d in model.graph.input[0].type.tensor_type.shape.dim
    )
    pictures = np.random.default_rng(1).random((1, channels, rows, columns), dtype=np.float32)
    assert largest_difference(model, pictures, 3 if "tiny" in name else 2) < 3e-6


def test_a_picture_is_the_same_in_any_batch_and_place():
    model = network(convolution(3, 4), convolution(4, 8))
    layers, _, _ = cut(model, "images")
    pictures = np.random.default_rng(2).random((5, 3, 12, 20), dtype=np.float32)
    together = thin(layers, pictures)
    for index, picture in enumerate(pictures):
        assert thin(layers, picture[None]).tobytes() == together[index].tobytes()


def test_the_model_stays_as_it_is_and_its_batch_is_kept():
    model = network(convolution(3, 4), batch=2)
    before = model.SerializeToString()
    _, rest, name = cut(model, "images")
    assert model.SerializeToString() == before
    (entry,) = rest.graph.input
    assert (entry.name, entry.type.tensor_type.shape.dim[0].dim_value) == (name, 2)


@pytest.mark.parametrize(
    "layer",
    [
        convolution(IN_MAX + 1, 4),
        convolution(3, OUT_MAX + 1),
        convolution(3, 4, conv={"kernel_shape": [5, 5], "pads": [2, 2, 2, 2]}),
        convolution(3, 4, conv={"pads": [0, 0, 0, 0]}),
        convolution(3, 4, conv={"pads": [1, 1, 0, 0]}),
        convolution(3, 4, conv={"auto_pad": "VALID", "pads": None}),
        convolution(3, 4, conv={"strides": [3, 3]}),
        convolution(3, 4, conv={"strides": [1, 2]}),
        convolution(4, 4, conv={"group": 2}),
        convolution(3, 4, conv={"dilations": [2, 2]}),
        convolution(3, 4, leaky={"alpha": 1.5}),
        convolution(3, 4, leaky={"alpha": -0.5}),
    ],
)
def test_other_layers_are_left_to_the_runtime(layer):
    model = network(layer, rows=24, columns=24)
    assert cut(model, "images") == ([], model, "images")


@pytest.mark.parametrize(
    "pool",
    [
        {"kernel_shape": [3, 3], "strides": [2, 2]},
        {"kernel_shape": [2, 2], "strides": [1, 1]},
        {"kernel_shape": [2, 2], "strides": [2, 2], "ceil_mode": 1},
        {"kernel_shape": [2, 2], "strides": [2, 2], "pads": [0, 0, 1, 1]},
        {"kernel_shape": [2, 2], "strides": [2, 2], "auto_pad": "SAME_UPPER"},
    ],
)
def test_other_pooling_is_left_to_the_runtime(pool):
    model = network(convolution(3, 4, pool=pool), rows=13, columns=13)
    layers, _, name = cut(model, "images")
    assert ([layer.pool for layer in layers], name) == ([False], "l0")
    pictures = np.random.default_rng(3).random((2, 3, 13, 13), dtype=np.float32)
    assert largest_difference(model, pictures, 1) < 2e-6


def test_what_somebody_else_reads_is_not_swallowed():
    """A layer whose result goes two ways, or out, ends what is cut off."""
    model = network(convolution(3, 4), convolution(4, 8))
    shape = ["batch", 4, None, None]
    model.graph.output.append(helper.make_tensor_value_info("l0", TensorProto.FLOAT, shape))
    layers, _, name = cut(model, "images")
    assert ([layer.pool for layer in layers], name) == ([False], "l0")
    pictures = np.random.default_rng(4).random((2, 3, 12, 20), dtype=np.float32)
    assert largest_difference(model, pictures, 1) < 2e-6
    twice = network(convolution(3, 4), convolution(4, 8))
    twice.graph.node.append(helper.make_node("Relu", ["p0"], ["again"]))
    twice.graph.output.append(helper.make_tensor_value_info("again", TensorProto.FLOAT, None))
    assert len(cut(twice, "images")[0]) == 1


def test_constants_may_be_listed_among_the_inputs():
    """As files below version 4 have to."""
    model = network(convolution(3, 4))
    model.ir_version = 3
    for tensor in model.graph.initializer:
        value = helper.make_tensor_value_info(tensor.name, tensor.data_type, tensor.dims)
        model.graph.input.append(value)
    pictures = np.random.default_rng(5).random((2, 3, 12, 20), dtype=np.float32)
    assert largest_difference(model, pictures, 1) < 2e-6


def test_a_network_with_branches_is_left_alone():
    """A branch may read anything, without being told."""
    model = network(convolution(3, 4))
    value = helper.make_tensor_value_info("seen", TensorProto.FLOAT, None)
    branch = helper.make_graph(
        [helper.make_node("Identity", ["images"], ["seen"])], "b", [], [value]
    )
    model.graph.initializer.append(numpy_helper.from_array(np.array(True), "yes"))
    model.graph.node.append(
        helper.make_node("If", ["yes"], ["looked"], then_branch=branch, else_branch=branch)
    )
    model.graph.output.append(helper.make_tensor_value_info("looked", TensorProto.FLOAT, None))
    assert cut(model, "images") == ([], model, "images")


def test_biases_that_do_not_fit_are_left_to_the_runtime():
    model = network(convolution(3, 8))
    model.graph.initializer[1].CopyFrom(numpy_helper.from_array(np.ones(4, np.float32), "b0"))
    assert cut(model, "images")[0] == []


def test_pictures_of_other_channels_are_refused():
    layers, _, _ = cut(network(convolution(4, 8)), "images")
    with pytest.raises(ValueError, match="a convolution reads 4 channels, given 3"):
        thin(layers, np.zeros((2, 3, 12, 20), np.float32))


def test_a_network_of_nothing_else_is_cut_off_completely():
    model = network(convolution(3, 4))
    del model.graph.node[-1], model.graph.output[:]
    shape = ["batch", 4, None, None]
    model.graph.output.append(helper.make_tensor_value_info("p0", TensorProto.FLOAT, shape))
    pictures = np.random.default_rng(6).random((2, 3, 12, 20), dtype=np.float32)
    assert largest_difference(model, pictures, 1) < 2e-6


def test_weights_that_are_computed_are_left_to_the_runtime():
    model = network(convolution(3, 4))
    model.graph.node.insert(0, helper.make_node("Neg", ["k0"], ["minus"]))
    model.graph.node[1].input[1] = "minus"
    assert cut(model, "images")[0] == []
