"""devkit.detector.frames: pictures where they lie, in constant batches; here on the CPU, on a GPU
by ``tests/device/network_check.py``."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import onnx
import onnxruntime
import pytest
from darknet_oracle import random_weights
from foreign_memory import Elsewhere
from msgspec.structs import astuple

from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.variant import architecture_network
from devkit.detector.decode import Selection
from devkit.detector.detector import Detector, ModelError
from devkit.detector.frames import MICRO_BATCH
from devkit.detector.resize import ONE, NetworkInput, taps
from devkit.images import Images, as_images
from schemas.messages import Detection

NAMES = ["car", "truck", "pedestrian", "traffic_sign"]
WIDTH, HEIGHT = 96, 64


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A narrow tiny network with random weights, and its file."""
    network = architecture_network("yolov3-tiny-w25", classes=4, width=WIDTH, height=HEIGHT)
    path = tmp_path_factory.mktemp("models") / "tiny.onnx"
    onnx.save(write_onnx(network, random_weights(network, 3), NAMES), path)
    return path


def pictures(count: int, width: int = 160, height: int = 90) -> np.ndarray:
    rng = np.random.default_rng(count)
    return rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)


def on_cpu(path, **more) -> Detector:
    return Detector(path, Selection(confidence_min=0.05), runtime="onnxruntime", **more)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [(160, 90), (90, 160), (1, 8), (2, 1), (33, 320), (640, 320), (101, 50), (7, 7)],
)
def test_the_resize_is_that_of_opencv(given, wanted):
    line = np.random.default_rng(given).integers(0, 256, (1, given, 3), dtype=np.uint8)
    first, second, weight = taps(given, wanted)
    whole = line.astype(np.int64)
    mixed = whole[:, first] * (ONE - weight)[:, None] + whole[:, second] * weight[:, None]
    resized = cv2.resize(line, (wanted, 1), interpolation=cv2.INTER_LINEAR_EXACT)
    assert np.array_equal((mixed + ONE // 2) // ONE, resized)


@pytest.mark.parametrize("order", ["rgb", "bgr"])
@pytest.mark.parametrize("size", [(160, 90), (64, 36), (97, 131), (WIDTH, HEIGHT), (640, 360)])
def test_what_the_network_gets_is_the_same_to_the_last_bit(model, size, order):
    """Beside OpenCV's resize and NumPy, from the host's memory and from where only the address is
    known."""
    detector = Detector(model)
    description = msgspec.structs.replace(detector.description, channel_order=order)
    entry = NetworkInput(description, size, 4, "cpu")
    frames, rows = pictures(3, *size), [2, 0, 2, 1]
    frames[0], frames[1, ::2] = 255, 0
    entry.fill(Images(frames, range(3)), rows)
    found = entry.planes.numpy().copy()
    entry.planes.zero_()
    entry.fill(Images(Elsewhere(frames), range(3)), rows)
    assert entry.planes.numpy().tobytes() == found.tobytes()
    entry.fill(Images(frames, range(3)), rows[:2])
    assert np.array_equal(entry.planes.numpy(), found[[0, 1, 0, 0]])
    expected = []
    for row in rows:
        image = cv2.resize(frames[row], (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR_EXACT)
        image = image if order == "rgb" else image[..., ::-1]
        expected.append(image.transpose(2, 0, 1) * np.float32(description.scale))
    assert found.dtype == np.float32
    assert found.tobytes() == np.stack(expected).tobytes()


def same_boxes(found: list[Detection], expected: list[Detection]) -> bool:
    """But for rounding: the first layers are computed in another order."""
    return [each.label for each in found] == [each.label for each in expected] and all(
        np.allclose(astuple(one)[1:], astuple(other)[1:], rtol=1e-5, atol=1e-4)
        for one, other in zip(found, expected, strict=True)
    )


@pytest.mark.slow
def test_constant_batches_give_what_the_network_gives_alone(model):
    images = pictures(MICRO_BATCH + 5)
    expected = on_cpu(model).raw(images)
    in_place = on_cpu(model, device="cpu", size_px=(160, 90))
    assert in_place.runtime == "onnxruntime cpu"
    whole = in_place.raw(images)
    for name, array in whole.items():
        assert np.allclose(array, expected[name], rtol=1e-5, atol=1e-5)
        assert in_place.raw(images[7:9])[name].tobytes() == array[7:9].tobytes()
    detections = in_place.detect(images[:3])
    assert len(detections.image) > 10
    for index in range(3):
        assert same_boxes(detections.of(index), on_cpu(model).detect(images[:3]).of(index))


def test_rows_are_chosen_where_the_pictures_lie(model):
    images = pictures(7)
    in_place = on_cpu(model, device="cpu", size_px=(160, 90))
    expected = in_place.raw(images)
    rows = [5, 0, 6, 2]
    for array in (images, Elsewhere(images)):
        for name, found in in_place.raw(Images(array, rows)).items():
            assert found.tobytes() == expected[name][rows].tobytes()


def test_no_picture_and_another_size(model):
    in_place = on_cpu(model, device="cpu")
    assert all(len(array) == 0 for array in in_place.raw([]).values())
    for size in ((160, 90), (WIDTH, HEIGHT), (320, 180)):
        found = in_place.detect(pictures(2, *size))
        assert same_boxes(found.of(1), on_cpu(model).detect(pictures(2, *size)).of(1))


def test_a_model_of_a_fixed_batch_keeps_it(model, tmp_path):
    fixed = onnx.load(model)
    for value in (*fixed.graph.input, *fixed.graph.output):
        value.type.tensor_type.shape.dim[0].dim_value = 2
    onnx.save(fixed, tmp_path / "fixed.onnx")
    images = pictures(5)
    expected = on_cpu(model).raw(images)
    for name, found in on_cpu(tmp_path / "fixed.onnx", device="cpu").raw(images).items():
        assert found.shape == expected[name].shape
        assert np.allclose(found, expected[name], atol=1e-4)


def test_what_is_no_array_of_pictures(model):
    in_place = on_cpu(model, device="cpu")
    with pytest.raises(ValueError, match="images of several sizes"):
        in_place.detect([*pictures(1), *pictures(1, 64, 36)])
    for wrong in (np.zeros((2, 8, 8), np.uint8), np.zeros((2, 8, 8, 3), np.float32)):
        with pytest.raises(ValueError, match=r"expected contiguous uint8 \[S, H, W, 3\]"):
            in_place.raw(Images(Elsewhere(wrong.reshape(2, 8, 8, -1)), [0]))
    with pytest.raises(ValueError, match="GPU's memory; this needs them in the host's"):
        Detector(model).detect(Images(Elsewhere(pictures(2)), [1]))
    assert as_images(Images(pictures(1), [0])).size_px == (160, 90)


@pytest.mark.skipif(
    "CUDAExecutionProvider" in onnxruntime.get_available_providers(), reason="it can use GPUs here"
)
def test_a_gpu_that_onnxruntime_cannot_use_is_one_line(model):
    with pytest.raises(ModelError) as caught:
        on_cpu(model, device="cuda:0")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(model))
    assert "CUDAExecutionProvider; install onnxruntime-gpu" in str(caught.value)
    with pytest.raises(ModelError, match=r"runtime 'opencv' on cuda:0, allowed: onnxruntime"):
        Detector(model, device="cuda:0")
