"""Imported networks against Darknet's layers in NumPy, in OpenCV and in ONNX Runtime."""

from __future__ import annotations

from functools import partial

import cv2
import msgspec
import numpy as np
import onnx
import onnxruntime
import pytest
from darknet_oracle import forward, random_weights, reorg, small_network

from devkit.darknet.network import DarknetNetwork, Route
from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.sections import DarknetError
from devkit.darknet.variant import ARCHITECTURES, architecture_network, coco_names
from devkit.detector.description import METADATA_KEY, DetectorDescription

TOLERANCE = 1e-4
"""Largest deviation, in standard deviations of the layer's output."""


def run_opencv(model: onnx.ModelProto, images: np.ndarray, names: list[str]):
    net = cv2.dnn.readNetFromONNX(np.frombuffer(model.SerializeToString(), np.uint8))
    net.setInput(images, "images")
    return dict(zip(names, net.forward(names), strict=True))


def run_onnxruntime(model: onnx.ModelProto, images: np.ndarray, names: list[str]):
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return dict(zip(names, session.run(names, {"images": images}), strict=True))


def compare(network: DarknetNetwork, *, fold: bool = True, batch: int = 2, seed: int = 1) -> int:
    """Every layer in both runtimes against the oracle; the number of layers compared."""
    weights = random_weights(network, seed)
    rng = np.random.default_rng(seed + 1)
    images = rng.random((batch, *network.input), dtype=np.float32)
    expected = forward(network, weights, images)
    classes = network.heads()[0].classes
    model = write_onnx(
        network, weights, [str(n) for n in range(classes)], fold=fold, every_layer=True
    )
    names = [output.name for output in model.graph.output]
    layers = {f"head_{n}": head.index for n, head in enumerate(network.heads())}
    layers |= {name: int(name[6:]) for name in names if name.startswith("layer_")}
    for run in (run_opencv, run_onnxruntime):
        for name, found in run(model, images, names).items():
            oracle = expected[layers[name]]
            worst = np.abs(found - oracle).max() / oracle.std()
            label = network.layers[layers[name]].label
            assert found.shape == oracle.shape, f"{run.__name__} {label}"
            assert worst < TOLERANCE, f"{run.__name__} {label}: {worst}"
    return len(layers)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARCHITECTURES)
def test_published_architectures_at_full_width_layer_by_layer(name):
    network = architecture_network(name, width=96, height=64)
    aliases = [x for x in network.layers if isinstance(x, Route) and len(x.inputs) == 1]
    assert compare(network, batch=1) == len(network.layers) - len(aliases)


@pytest.mark.parametrize("name", ["yolov2-tiny", "yolov3"])
def test_batch_normalisation_as_a_node_of_its_own(name):
    compare(architecture_network(f"{name}-w25", width=96, height=64), fold=False)


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_quarter_width_variants_layer_by_layer(name):
    compare(architecture_network(f"{name}-w25", classes=4, width=160, height=96), batch=3)


small = partial(small_network, width=30, height=20)


@pytest.mark.parametrize("activation", ["linear", "leaky", "logistic", "relu", "mish", "swish"])
def test_activations(activation):
    compare(small(f"[convolutional]\nbatch_normalize=1\nfilters=5\nactivation={activation}\n"))
    compare(small(f"[convolutional]\nfilters=8\n[shortcut]\nfrom=-2\nactivation={activation}\n"))


@pytest.mark.parametrize("options", ["size=3", "size=3\npad=1\nstride=2", "size=5\npadding=1"])
@pytest.mark.parametrize("groups", [1, 4])
def test_convolutions(options, groups):
    compare(small(f"[convolutional]\nfilters=12\n{options}\ngroups={groups}\n"))


@pytest.mark.parametrize("size", [1, 2, 3, 5])
@pytest.mark.parametrize("stride", [1, 2, 5])
@pytest.mark.parametrize("padding", ["", "padding=0\n"])
def test_pools(size, stride, padding):
    compare(small(f"[maxpool]\nsize={size}\nstride={stride}\n{padding}"))


def test_the_padding_of_a_pool_never_wins():
    network = small("[maxpool]\nsize=2\nstride=1\n")
    weights = random_weights(network, 3)
    weights.convolutions[0].biases[:] = -50.0  # zeros around would be the largest
    images = np.random.default_rng(0).random((1, 3, 20, 30), dtype=np.float32)
    model = write_onnx(network, weights, ["a", "b"], every_layer=True)
    expected = forward(network, weights, images)[1]
    for run in (run_opencv, run_onnxruntime):
        names = [output.name for output in model.graph.output]
        pooled = run(model, images, names)["layer_1"]
        assert pooled.max() < -40
        assert np.allclose(pooled, expected, atol=1e-4)


@pytest.mark.parametrize("options", ["groups=2\ngroup_id=0", "groups=2\ngroup_id=1", "groups=4"])
def test_routes_of_groups(options):
    compare(small(f"[convolutional]\nfilters=4\n[route]\nlayers=-1,0,-1\n{options}\n"))


def test_upsample_and_reorg():
    compare(small("[upsample]\nstride=2\nscale=0.5\n[reorg]\nstride=2\n"))
    compare(small("[upsample]\n[maxpool]\nstride=2\n[reorg]\nstride=2\n[upsample]\nstride=3\n"))


def test_reorg_is_not_the_plain_space_to_depth():
    # Memory 0 to 15 counts as one channel of 4x4; its 2x2 blocks' pixels become the channels.
    found = reorg(np.arange(16, dtype=np.float32).reshape(4, 2, 2), 2).reshape(4, 4)
    assert found.tolist() == [[0, 2, 8, 10], [1, 3, 9, 11], [4, 6, 12, 14], [5, 7, 13, 15]]


def test_kernels_of_half_the_size_compute_as_their_rounded_numbers():
    network = architecture_network("yolov3-tiny-w25", width=96, height=64)
    weights = random_weights(network, 1)
    plain = write_onnx(network, weights, coco_names())
    half = write_onnx(network, weights, coco_names(), half=True)
    assert half.ByteSize() < 0.55 * plain.ByteSize()
    for tensor in plain.graph.initializer:
        if tensor.name.endswith("_kernels"):
            rounded = onnx.numpy_helper.to_array(tensor).astype(np.float16).astype(np.float32)
            tensor.CopyFrom(onnx.numpy_helper.from_array(rounded, tensor.name))
    images = np.random.default_rng(0).random((2, *network.input), dtype=np.float32)
    for run in (run_opencv, run_onnxruntime):
        left, right = (run(model, images, ["head_0", "head_1"]) for model in (half, plain))
        for name in left:
            assert np.array_equal(left[name], right[name])


def test_numbers_too_large_for_half_are_refused():
    network = small("")
    weights = random_weights(network, 1)
    weights.convolutions[0].kernels[0, 0, 0, 0] = 1e5
    with pytest.raises(DarknetError, match="layer_0_kernels holds numbers too large for float16"):
        write_onnx(network, weights, ["a", "b"], half=True)


def test_metadata_says_all_that_decoding_needs():
    network = architecture_network("yolov3-tiny", width=96, height=64)
    model = write_onnx(network, random_weights(network, 1), coco_names())
    (entry,) = (p for p in model.metadata_props if p.key == METADATA_KEY)
    description = msgspec.json.decode(entry.value, type=DetectorDescription)
    assert (description.width, description.height) == (96, 64)
    assert description.names[2] == "car"
    assert [head.output for head in description.heads] == ["head_0", "head_1"]
    assert description.heads[0].anchors_px == [(81.0, 82.0), (135.0, 169.0), (344.0, 319.0)]
    assert {head.scores for head in description.heads} == {"logistic"}
    region = architecture_network("yolov2-tiny", width=96, height=64)
    model = write_onnx(region, random_weights(region, 1), coco_names())
    description = msgspec.json.decode(model.metadata_props[0].value, type=DetectorDescription)
    assert description.heads[0].scores == "softmax"
    assert description.heads[0].anchors_px[0] == pytest.approx((0.57273 * 32, 0.677385 * 32))
