"""Networks in torch against the ONNX files that are written of them, layer by layer."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import pytest
import torch
from darknet_oracle import random_weights, small_network

from devkit.darknet.network import IMAGE, DarknetNetwork, Head
from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import ARCHITECTURES, architecture_network
from devkit.detector.detector import Detector
from devkit.training.network import TorchNetwork

TOLERANCE = 1e-4
"""Largest deviation, in standard deviations of the layer's output."""


def with_weights(network: DarknetNetwork, seed: int = 3) -> TorchNetwork:
    model = TorchNetwork(network, seed=0)
    model.load_weights(random_weights(network, seed))
    return model.eval()


def compare(network: DarknetNetwork) -> int:
    """Every layer of the torch network against the ONNX file; the number of layers compared."""
    model = with_weights(network)
    classes = network.heads()[0].classes
    names = [str(n) for n in range(classes)]
    written = write_onnx(network, model.weights(seen=0), names, every_layer=True)
    session = onnxruntime.InferenceSession(
        written.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    images = np.random.default_rng(1).random((2, *network.input), dtype=np.float32)
    with torch.no_grad():
        found = model.layers(torch.from_numpy(images))
    wanted = [output.name for output in written.graph.output if output.name[:6] == "layer_"]
    for name, expected in zip(wanted, session.run(wanted, {"images": images}), strict=True):
        own = found[int(name[6:])].numpy()
        assert own.shape == expected.shape, name
        assert np.abs(own - expected).max() / expected.std() < TOLERANCE, name
    return len(wanted)


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_architectures_layer_by_layer(name):
    network = architecture_network(f"{name}-w25", classes=4, width=160, height=96)
    # Routes of one layer are that layer; heads have no output of their own.
    heads = len(network.heads())
    alone = sum(layer.kind == "route" and len(layer.inputs) == 1 for layer in network.layers)
    assert compare(network) == len(network.layers) - heads - alone


small = partial(small_network, width=32, height=24)


@pytest.mark.parametrize("activation", ["linear", "leaky", "logistic", "relu", "mish", "swish"])
def test_activations(activation):
    compare(small(f"[convolutional]\nbatch_normalize=1\nfilters=5\nactivation={activation}\n"))
    compare(small(f"[convolutional]\nfilters=8\n[shortcut]\nfrom=-2\nactivation={activation}\n"))


@pytest.mark.parametrize("size", [1, 2, 3, 5])
@pytest.mark.parametrize("stride", [1, 2, 5])
@pytest.mark.parametrize("padding", ["", "padding=0\n"])
def test_pools(size, stride, padding):
    compare(small(f"[maxpool]\nsize={size}\nstride={stride}\n{padding}"))


@pytest.mark.parametrize(
    "layers",
    [
        "[convolutional]\nfilters=12\nsize=3\nstride=2\npad=1\ngroups=4\n",
        "[convolutional]\nfilters=4\n[route]\nlayers=-1,0,-1\ngroups=2\ngroup_id=1\n",
        "[upsample]\nstride=3\nscale=0.5\n",
        "[reorg]\nstride=2\n",
    ],
)
def test_other_layers(layers):
    compare(small(layers))


@pytest.mark.parametrize("name", ["yolov2-tiny", "yolov3"])
@pytest.mark.parametrize("runtime", ["opencv", "onnxruntime"])
def test_the_exported_detector_says_what_torch_says(name, runtime, tmp_path: Path):
    network = architecture_network(f"{name}-w25", classes=4, width=160, height=96)
    model = with_weights(network)
    path = tmp_path / "a.onnx"
    names = ["car", "truck", "pedestrian", "traffic_sign"]
    path.write_bytes(write_onnx(network, model.weights(7), names).SerializeToString())
    images = np.random.default_rng(2).integers(0, 256, (3, 96, 160, 3), dtype=np.uint8)
    cv2.setNumThreads(1)
    found = Detector(path, runtime=runtime).raw(images)
    with torch.no_grad():
        raw = model(torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255.0)
    assert len(raw) == len(network.heads())
    for index, expected in enumerate(raw):
        deviation = np.abs(found[f"head_{index}"] - expected.numpy()).max()
        assert deviation / float(expected.std()) < TOLERANCE


def test_weights_go_in_and_out_unchanged():
    network = architecture_network("yolov3-tiny-w25", classes=4, width=96, height=96)
    given = random_weights(network, 9)
    found = with_weights(network, 9).weights(seen=640)
    assert found.seen == 640
    for index, numbers in given.convolutions.items():
        for part in ("kernels", "biases", "scales", "means", "variances"):
            expected = getattr(numbers, part)
            if expected is None:
                assert getattr(found.convolutions[index], part) is None
            else:
                assert np.array_equal(getattr(found.convolutions[index], part), expected)


def test_an_untrained_network_expects_background():
    for name, prior in (("yolov2-tiny", 0.1), ("yolov3-tiny", 0.01)):
        network = architecture_network(f"{name}-w25", classes=4, width=96, height=96)
        raw = TorchNetwork(network, 1).eval()(torch.zeros(1, 3, 96, 96))
        for head, values in zip(network.heads(), raw, strict=True):
            grid = values.view(1, len(head.anchors_px), 9, *values.shape[2:])
            certain = torch.sigmoid(grid[:, :, 4])
            assert certain.mean().item() == pytest.approx(prior, rel=0.2)


def test_the_seed_decides_the_kernels():
    network = small("[convolutional]\nbatch_normalize=1\nfilters=4\n")
    first, again, other = (TorchNetwork(network, seed) for seed in (1, 1, 2))
    for index in (0, 1):
        kernels = [m.block(index).convolution.weight for m in (first, again, other)]
        assert torch.equal(kernels[0], kernels[1])
        assert not torch.equal(kernels[0], kernels[2])


def test_images_and_heads_are_no_layers_with_output():
    network = small("")
    outputs = with_weights(network).layers(torch.zeros(1, *network.input))
    heads = [layer.index for layer in network.layers if isinstance(layer, Head)]
    assert IMAGE in outputs
    assert not set(heads) & set(outputs)
