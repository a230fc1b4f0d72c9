"""Networks in the stack: the same for any grouping, loaded once, and what a bad file is told."""

from __future__ import annotations

import random
import sys
from typing import ClassVar

import cv2
import msgspec
import numpy as np
import onnx
import pytest
from camera_sites import camera_site
from darknet_oracle import random_weights
from tiny_networks import write_dark_spot_detector

import devkit.detector.detector
import devkit.detector.model_files
import devkit.detector.network_perception
from devkit.aeb import AebStack
from devkit.darknet.build import build_network
from devkit.darknet.importer import darknet_model
from devkit.darknet.onnx_writer import write_onnx
from devkit.darknet.sections import to_text
from devkit.darknet.variant import architecture, architecture_network
from devkit.darknet.weights import write_weights
from devkit.detector.decode import Selection
from devkit.detector.detector import Detector
from devkit.detector.model_files import open_detector, runtime_of, shipped_models
from devkit.detector.network_perception import REPORTED_MAX, _most_confident
from devkit.hosting.host import expect, serve
from devkit.images import Images
from devkit.perception import Setting, build_perception
from devkit.reference.eyes import Eyes
from devkit.stack import Observation
from schemas.files.assets import file_digest
from schemas.messages import BOXES_MAX, Command, Commands, Detection, Episode, Tick
from schemas.sections.perception import GroundTruthPerception, NetworkPerception
from schemas.wire.expected import Expected
from twin.base.errors import InfrastructureError, UsageError
from twin.fabric.drive import Incoming

WIDTH, HEIGHT = 96, 64
NAMES = ["car", "person", "stop sign", "kite"]
NO_BOXES = np.zeros((0, 7), np.float32)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Two narrow networks with random weights: paths."""
    folder = tmp_path_factory.mktemp("models")
    paths = []
    for seed, name in enumerate(("yolov3-tiny-w25", "yolov2-tiny-w25")):
        network = architecture_network(name, classes=4, width=WIDTH, height=HEIGHT)
        paths.append(folder / f"{name}.onnx")
        onnx.save(write_onnx(network, random_weights(network, seed), NAMES), paths[-1])
    return paths


@pytest.fixture
def threads():
    before = cv2.getNumThreads()
    yield cv2.setNumThreads
    cv2.setNumThreads(before)


def variant(path, **changes) -> NetworkPerception:
    return NetworkPerception(model=str(path), **{"confidence_min": 0.1, **changes})


def frames(count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    small = rng.integers(0, 256, (count, 6, 10, 3), dtype=np.uint8)
    return np.stack([cv2.resize(image, (160, 90)) for image in small])


def episode(slot: int, token: int, perception, **changes) -> Episode:
    return Episode(
        v=1,
        seq=0,
        slot=slot,
        token=token,
        case=f"case-{token}",
        seed=1,
        model="any",
        perception=perception,
        camera="front_right",
        width=160,
        height=90,
        hfov_deg=70.0,
        control_period_ns=50_000_000,
        cameras=[camera_site(160, 90)],
        **changes,
    )


def observe(pictures: np.ndarray, tokens: list[int]) -> Observation:
    slots = len(tokens)
    return Observation(
        seq=0,
        active=np.array([token >= 0 for token in tokens]),
        token=np.array(tokens),
        tick=np.zeros(slots, np.int32),
        sim_time_ns=np.zeros(slots, np.int64),
        sensors={
            "camera": pictures,
            "boxes": np.zeros((slots, BOXES_MAX, 7), np.float32),
            "vehicle": np.tile([8.0, 0, 0, 0, 0, 0, 0], (slots, 1)),
            "environment": np.zeros((slots, 2)),
        },
        counts={"boxes": np.zeros(slots, np.int32)},
    )


def drive(variants: dict[int, object], order: list[int], pictures: np.ndarray) -> dict[int, bytes]:
    """Token -> its command, packed; -1 in ``order`` is an empty slot."""
    stack = AebStack(len(order))
    for slot, token in enumerate(order):
        if token >= 0:
            stack.reset(slot, episode(slot, token, variants[token]))
    commands = stack.step(observe(pictures[order], order))
    costs = stack.costs()
    assert len(costs) == len(commands) == sum(token >= 0 for token in order)
    assert all(cost.frames == 1 and cost.wall_s > 0 for cost in costs)
    encode = msgspec.msgpack.encode
    return {c.token: encode(msgspec.structs.replace(c, slot=0)) for c in commands}


@pytest.mark.parametrize("runtime", ["opencv", "onnxruntime"])
def test_a_command_does_not_depend_on_the_grouping(models, threads, runtime):
    pictures = frames(16)
    kinds = [
        variant(models[0], runtime=runtime),
        variant(models[1], runtime=runtime),
        variant(models[0], runtime=runtime, confidence_min=0.3, order="place"),
        GroundTruthPerception(),
    ]
    variants = dict(enumerate(kinds * 4))
    threads(1)
    alone = {token: drive(variants, [token], pictures)[token] for token in variants}
    decoded = [msgspec.msgpack.decode(each, type=Command) for each in alone.values()]
    assert sum(len(command.detections) for command in decoded) > 20
    shuffled = list(range(16))
    random.Random(3).shuffle(shuffled)
    for count in (1, 2):
        threads(count)
        for order in ([5, 0, 9], shuffled, [*shuffled[:7], -1, 2, -1][::-1]):
            for token, command in drive(variants, order, pictures).items():
                assert command == alone[token]


def test_a_network_is_loaded_once_for_all_that_select_from_it(models, monkeypatch, tmp_path):
    path = tmp_path / "own.onnx"
    path.write_bytes(models[0].read_bytes())
    loaded = []
    real = devkit.detector.detector.read_model
    monkeypatch.setattr(
        devkit.detector.detector, "read_model", lambda p: (loaded.append(p), real(p))[1]
    )
    stack = AebStack(3)
    for token in range(12):
        changes = {"confidence_min": 0.1 + 0.05 * (token % 3), "across_classes": token % 2 == 0}
        stack.reset(token % 3, episode(token % 3, token, variant(path, **changes)))
    assert loaded == [path]


class OnDevice:
    """Pictures that say they lie in a device's memory, which here is the host's."""

    def __init__(self, pictures: np.ndarray):
        self.shape, self.dtype, self._pictures = pictures.shape, pictures.dtype, pictures
        self.__cuda_array_interface__ = pictures.__array_interface__

    def host(self) -> np.ndarray:
        return self._pictures


@pytest.mark.parametrize("runtime", ["opencv", "frames"])
def test_variants_that_share_a_network_do_not_disturb_each_other(models, monkeypatch, runtime):
    place = ("onnxruntime", "cpu") if runtime == "frames" else ("opencv", "")
    monkeypatch.setattr(devkit.detector.model_files, "runtime_of", lambda *_: place)
    devkit.detector.network_perception._network.cache_clear()
    pictures, slots = frames(8), list(range(8))
    eyes = Eyes(8)
    for slot in slots:
        kind = variant(models[0], confidence_min=0.1 + 0.01 * (slot % 4))
        eyes.reset(slot, episode(slot, slot, kind))
    one_by_one = eyes.look(slots, observe(pictures, slots))
    together = observe(OnDevice(pictures), slots)
    for _ in range(10):
        assert eyes.look(slots, together) == one_by_one
    devkit.detector.network_perception._network.cache_clear()


def test_what_is_expected_is_loaded_once_and_what_cannot_be_is_told_by_the_case(
    models, tmp_path, monkeypatch
):
    opened = []
    real = devkit.detector.model_files.open_detector

    def open_detector(given, *rest):
        opened.append(given.model)
        return real(given, *rest)

    monkeypatch.setattr(devkit.detector.model_files, "open_detector", open_detector)
    devkit.detector.network_perception._network.cache_clear()
    near, gone = variant(models[0]), variant(tmp_path / "gone.onnx")
    first, second = episode(0, 1, near), episode(1, 2, gone)
    text = msgspec.json.encode(
        [Expected(e.perception, e.width, e.height, e.device, e.files) for e in (first, second)]
    )
    stack = AebStack(2)
    expect(stack, msgspec.json.decode(text, type=list[Expected]))
    assert opened == [near.model, gone.model]
    stack.reset(0, first)
    assert opened == [near.model, gone.model]
    with pytest.raises(UsageError, match=r"gone\.onnx: No such file"):
        stack.reset(1, second)


def test_selection_and_order_are_those_of_the_variant(models):
    images = Images(frames(2), [1, 0])
    detector = Detector(models[0])
    for selection, order in (
        ({"confidence_min": 0.1}, "confidence"),
        ({"confidence_min": 0.3, "overlap_max": 0.1, "across_classes": True}, "place"),
    ):
        eyes = build_perception(variant(models[0], order=order, **selection), Setting())
        found = detector.detect(images, Selection(**selection))
        for index, seen in enumerate(eyes.detect(images, [NO_BOXES] * 2)):
            expected = found.of(index, by_place=order == "place")
            assert [d.confidence for d in seen] == [d.confidence for d in expected]
            assert len(seen) > 0


def test_labels_of_coco_get_our_names(models):
    (seen,) = build_perception(variant(models[0]), Setting()).detect(
        Images(frames(1), [0]), [NO_BOXES]
    )
    labels = {detection.label for detection in seen}
    assert labels <= {"car", "pedestrian", "traffic_sign", "kite"}
    assert labels & {"pedestrian", "traffic_sign"}


def test_a_dark_car_is_braked_for(tmp_path):
    path = write_dark_spot_detector(tmp_path / "dark.onnx")
    bright = np.full((1, 90, 160, 3), 200, np.uint8)
    dark = bright.copy()
    dark[0, 45:70, 80:120] = 10
    eyes = build_perception(variant(path, confidence_min=0.5), Setting())
    assert eyes.runtime == "opencv cpu"
    assert eyes.detect(Images(bright, [0]), [NO_BOXES]) == [[]]
    (seen,) = eyes.detect(Images(dark, [0]), [NO_BOXES])
    assert {detection.label for detection in seen} == {"car"}
    stack = AebStack(1, frames_min=1)
    stack.reset(0, episode(0, 7, variant(path)))
    assert not stack.step(observe(bright, [7]))[0].aeb
    assert stack.step(observe(dark, [7]))[0].aeb


def test_a_darknet_network_by_its_files(tmp_path):
    sections = architecture("yolov2-tiny-w25", classes=2, width=WIDTH, height=HEIGHT)
    cfg, weights, names = (tmp_path / f"a.{suffix}" for suffix in ("cfg", "weights", "names"))
    cfg.write_text(to_text(sections))
    network = build_network(sections, "a.cfg")
    write_weights(weights, network, random_weights(network, 5))
    names.write_text("car\nperson\n")
    files = {str(path): file_digest(path) for path in (cfg, weights, names)}
    given = variant(cfg, weights=str(weights), names=str(names), confidence_min=0.02)
    images = Images(frames(1), [0])
    (seen,) = build_perception(given, Setting(files=files)).detect(images, [NO_BOXES])
    detector = Detector(
        cfg, Selection(confidence_min=0.02), model=darknet_model(cfg, weights, names)
    )
    assert [d.confidence for d in seen] == [d.confidence for d in detector.detect(images).of(0)]
    assert len(seen) > 0
    weights.write_bytes(weights.read_bytes()[:-4])
    assert "not the file that the campaign was submitted with" in refused(given, files)
    assert "a.weights: ends in layer 14" in refused(given, {})


def test_of_too_many_objects_the_most_confident_are_reported_in_their_order():
    confidence = np.random.default_rng(4).permutation(np.repeat(np.arange(1, 91) / 100, 2))
    many = [Detection("car", each, i, 0, 1, 1) for i, each in enumerate(confidence.tolist())]
    some = _most_confident(many)
    assert len(some) == REPORTED_MAX < len(many)
    places = [detection.x_px for detection in some]
    assert places == sorted(places)
    assert {d.confidence for d in some} == {d.confidence for d in many if d.confidence > 0.4}
    assert _most_confident(many[:REPORTED_MAX]) == many[:REPORTED_MAX]
    alike = [Detection("car", 0.5, i, 0, 1, 1) for i in range(REPORTED_MAX + 9)]
    assert _most_confident(alike) == alike[:REPORTED_MAX]


# --- what cannot be used ------------------------------------------------------------------------


def refused(given: NetworkPerception, files: dict[str, str], device: str = "cpu") -> str:
    with pytest.raises(UsageError) as caught:
        open_detector(given, files, device)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_files_that_are_not_those_of_the_submission(models, tmp_path):
    path = tmp_path / "x.onnx"
    path.write_bytes(models[0].read_bytes())
    files = {str(path): file_digest(path)}
    open_detector(variant(path), files, "cpu")
    path.write_bytes(models[1].read_bytes())
    line = refused(variant(path), files)
    assert line.startswith(f"{path}: not the file that the campaign was submitted with")
    path.unlink()
    assert refused(variant(path), files) == f"{path}: No such file or directory"
    with pytest.raises(UsageError, match="No such file"):
        AebStack(1).reset(0, episode(0, 1, variant(path), files=files))


def test_a_runtime_that_is_not_installed(models, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    line = refused(variant(models[0], runtime="onnxruntime"), {})
    assert line == f"{models[0]}: onnxruntime is not installed; install it, or choose opencv"


def test_numbers_in_a_file_beside_the_model(models, tmp_path):
    path = tmp_path / "split.onnx"
    onnx.save(onnx.load(models[0]), path, save_as_external_data=True, size_threshold=0)
    line = refused(variant(path), {})
    assert line == f"{path}: its numbers lie in another file; save it as one file"


def test_what_the_host_says_of_a_missing_file(tmp_path):
    """One line for the worker's log, without type and place in our code."""

    class Link:
        answers: ClassVar[list[Commands]] = []

        def receive(self, on_wait):
            if self.answers:
                raise InfrastructureError("the simulator went away")
            given = variant(tmp_path / "gone.onnx")
            tick = Tick(1, 0, [True], [1], [0], [0], [], 1)
            return Incoming(tick, [episode(0, 1, given)], {}, {})

        def answer(self, commands):
            self.answers.append(commands)

    with pytest.raises(InfrastructureError):
        serve(Link(), AebStack(1))
    assert Link.answers[0].error == f"{tmp_path}/gone.onnx: No such file or directory"


def test_names_that_are_not_shipped():
    line = refused(variant("yolov3"), {})
    assert line.startswith("yolov3: the published weights are not shipped; give 'weights: ")
    assert "devkit import-darknet" in line
    assert "yolov3.cfg yolov3.weights --out yolov3.onnx" in line
    assert "yolov9: no such model is shipped" in refused(variant("yolov9"), {})
    assert "did you mean 'yolov3'?" in refused(variant("yolo3", weights="x.weights"), {})
    assert "x.weights: No such file" in refused(variant("yolov3", weights="x.weights"), {})


def test_shipped_models_have_cards_and_can_be_loaded():
    for name, path in shipped_models().items():
        assert path.with_suffix(".md").is_file(), f"{path} has no model card"
        assert open_detector(variant(name), {}, "cpu").path == path


def test_the_runtime_is_that_of_the_worker(models):
    given = [variant("x.onnx", runtime=name) for name in ("auto", "opencv", "onnxruntime")]
    on_cpu = [runtime_of(each, "cpu") for each in given]
    on_gpu = [runtime_of(each, "cuda:1") for each in given]
    assert on_cpu == [("opencv", ""), ("opencv", ""), ("onnxruntime", "")]
    assert on_gpu == [("onnxruntime", "cuda:1"), ("opencv", ""), ("onnxruntime", "cuda:1")]
    assert open_detector(variant(models[0], runtime="onnxruntime"), {}, "cpu").runtime == (
        "onnxruntime cpu"
    )
    assert (
        open_detector(given[1].__class__(model=str(models[0])), {}, "cpu").runtime == "opencv cpu"
    )
