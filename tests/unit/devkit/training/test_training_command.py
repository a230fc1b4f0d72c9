"""``devkit train`` and ``devkit evaluate`` on real images of a small dataset."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from waiting import PATIENCE_S

from devkit.darknet.build import read_network
from devkit.detector.detector import Detector
from devkit.detector.labelled_images import parse_classes, read_labelled
from devkit.detector.scoring import SELECTION, score_detector
from devkit.training import folder as training_folder
from devkit.training.command import Trained, TrainingRequest, run_training
from twin.base.errors import UnfinishedError, UsageError
from twin.dataset.command import DatasetRequest, run_dataset

CLASSES = "car,pedestrian"

STILL = ("jitter=0", "flip=0", "hue=0", "saturation=1", "exposure=1")

CFG = """[net]
width=160
height=96
[convolutional]
batch_normalize=1
filters={first}
size=3
stride=2
pad=1
activation=leaky
[convolutional]
batch_normalize=1
filters={second}
size=3
stride=2
pad=1
activation=leaky
[convolutional]
batch_normalize=1
filters={third}
size=3
stride=2
pad=1
activation=leaky
[convolutional]
filters=21
size=1
stride=1
activation=linear
[yolo]
mask=0,1,2
anchors=8,8,16,16,30,30
classes=2
num=3
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """20 images of the twin, 16 to learn from."""
    out = tmp_path_factory.mktemp("dataset") / "data"
    plain = {"count": 20, "seed": 5, "cameras": 1}
    request = DatasetRequest(
        out=out, plain=plain, size="160x96", split_shares="0.8,0.2,0", streets="1,1,1", slots=4
    )
    run_dataset(request)
    return out


@pytest.fixture(scope="module")
def cfgs(tmp_path_factory) -> Path:
    """``small.cfg`` learns fast, ``tiny.cfg`` steps fast."""
    path = tmp_path_factory.mktemp("cfg")
    (path / "small.cfg").write_text(CFG.format(first=16, second=32, third=96))
    (path / "tiny.cfg").write_text(CFG.format(first=4, second=4, third=8))
    return path


@pytest.fixture(scope="module")
def train(data, cfgs):
    """Trains in this process; options of the tiny network unless others are given."""

    def run(out: Path, *, settings: tuple[str, ...] = (), size=None, **plain: Any) -> Trained:
        usual = {
            "model": str(cfgs / "tiny.cfg"), "classes": CLASSES, "epochs": 4, "batch": 8,
            "threads": 1, "validate_every": 2,
        }  # fmt: skip
        request = TrainingRequest(
            data=plain.pop("data", data), out=out, plain=usual | plain, size=size,
            settings=settings,
        )  # fmt: skip
        return run_training(request)

    return run


@pytest.fixture(scope="module")
def finished(train, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    train(out)
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# --- what comes out -------------------------------------------------------------------------------


def test_it_learns_its_images_by_heart(train, data, cfgs, tmp_path):
    settings = (*STILL, "ema_decay=0.9", "learning_rate=0.01")
    trained = train(
        tmp_path / "out", model=str(cfgs / "small.cfg"), epochs=120, batch=8,
        validate_every=0, settings=settings,
    )  # fmt: skip
    detector = Detector(Path(trained.model), SELECTION, runtime="onnxruntime")
    images = read_labelled(data, ["train"], parse_classes(CLASSES))
    card = score_detector(detector, images, lambda done, total: None)
    classes = card.evaluation.all.classes
    assert classes["car"].truths >= 30
    assert classes["pedestrian"].truths >= 10
    # What two objects want of one place, or suppress of each other, is lost for good.
    assert card.evaluation.all.mean_ap > 0.9
    found = [f for g in card.recalls["size_px"].values() for f in g.values() if f.objects]
    assert sum(f.found for f in found) > 0.8 * sum(f.objects for f in found)


def test_the_folder_of_a_finished_training(finished, data):
    assert set(files(finished)) == {
        "training.yaml", "log.csv", "tiny.onnx", "tiny.cfg", "scores.json", "MODEL.md"
    }  # fmt: skip
    head = yaml.safe_load((finished / "training.yaml").read_text())
    assert head["complete"] is True
    assert head["dataset"]["seed"] == 5
    assert head["dataset"]["images"] == 16
    assert head["parameters"]["recipe"]["flip"] == 0.5
    assert head["torch"] == torch.__version__
    rows = list(csv.DictReader((finished / "log.csv").read_text().splitlines()))
    assert [row["epoch"] for row in rows] == ["1", "2", "3", "4"]
    assert [bool(row["map50"]) for row in rows] == [False, True, False, True]
    parts = [float(rows[0][part]) for part in ("box", "objectness", "background", "class")]
    assert sum(parts) == pytest.approx(float(rows[0]["loss"]), rel=1e-4)
    card = (finished / "MODEL.md").read_text()
    for part in ("# tiny", "twin dataset data --count 20 --seed 5", "## Known failures",
                 "--epochs 4", "Apache-2.0", "| weather "):  # fmt: skip
        assert part in card


def test_anchors_are_those_of_the_data(finished, data):
    network = read_network(finished / "tiny.cfg")
    description = Detector(finished / "tiny.onnx").description
    anchors = network.heads()[0].anchors_px
    assert tuple(description.heads[0].anchors_px) == anchors
    assert description.names == ["car", "pedestrian"]
    assert anchors != ((8, 8), (16, 16), (30, 30))
    assert sorted(anchors, key=lambda a: a[0] * a[1]) == list(anchors)


@pytest.mark.parametrize("size", [None, "96x64"])
def test_log_and_exported_file_agree_about_the_last_epoch(train, data, tmp_path, size):
    # Enough epochs to see something; also where images and boxes are resized.
    trained = train(
        tmp_path / "out", epochs=25, validate_every=25, size=size,
        settings=("learning_rate=0.02", "ema_decay=0.5"),
    )  # fmt: skip
    rows = list(csv.DictReader((tmp_path / "out" / "log.csv").read_text().splitlines()))
    assert float(rows[-1]["map50"]) == pytest.approx(trained.scores["held_out"]["map50"], abs=1e-3)
    assert float(rows[-1]["map50"]) > 0
    assert float(rows[-1]["loss"]) < float(rows[0]["loss"])
    description = Detector(Path(trained.model)).description
    assert (description.width, description.height) == ((160, 96) if size is None else (96, 64))


def test_half_the_file(train, finished, tmp_path):
    trained = train(tmp_path / "out", half=True)
    assert Path(trained.model).stat().st_size < (finished / "tiny.onnx").stat().st_size
    assert Detector(Path(trained.model)).description.names == ["car", "pedestrian"]


# --- the same again -------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes_and_another_one_others(train, finished, tmp_path):
    train(tmp_path / "again")
    for name in ("tiny.onnx", "log.csv", "training.yaml", "scores.json", "MODEL.md"):
        assert (tmp_path / "again" / name).read_bytes() == (finished / name).read_bytes(), name
    train(tmp_path / "other", seed=2)
    model = (tmp_path / "other" / "tiny.onnx").read_bytes()
    assert model != (finished / "tiny.onnx").read_bytes()


def interrupt(monkeypatch, steps: int, number: int) -> None:
    """Send a signal at this step of trainings in this process."""
    step = training_folder.torch.optim.AdamW.step
    left = [steps]

    def interrupted(self, *arguments, **named):
        left[0] -= 1
        if left[0] == 0:
            signal.raise_signal(number)
        return step(self, *arguments, **named)

    monkeypatch.setattr(torch.optim.AdamW, "step", interrupted)


@pytest.mark.parametrize("steps", [1, 2, 5, 8])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_changes_nothing(train, finished, tmp_path, monkeypatch, steps, number):
    out = tmp_path / "out"
    interrupt(monkeypatch, steps, number)
    kind = KeyboardInterrupt if number == signal.SIGINT else UnfinishedError
    with pytest.raises(kind):
        train(out)
    monkeypatch.undo()
    assert (out / "checkpoint.pt").exists()
    assert not (out / "tiny.onnx").exists()
    (out / ".checkpoint.pt.1234.tmp").write_bytes(b"a process was killed while it wrote")
    train(out)
    assert files(out) == files(finished)


def test_a_finished_folder_is_left_as_it_is(train, finished, data):
    before = files(finished)
    again = run_training(TrainingRequest(data=data, out=finished, plain={}))
    assert files(finished) == before
    assert again.scores == json.loads(before["scores.json"])


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 3}, "begun with seed 1, given 3; leave the option away"),
        ({"epochs": 5}, "begun with epochs 4, given 5"),
        ({"settings": ("flip=0",)}, "begun with flip 0.5, given 0"),
        ({"size": "320x192"}, "begun with width 160, given 320"),
    ],
)
def test_a_folder_of_other_parameters(train, finished, changes, message):
    before = files(finished)
    with pytest.raises(UsageError, match=message):
        train(finished, **changes)
    assert files(finished) == before


@pytest.mark.parametrize("key", ["software", "torch", "data", "device_class"])
def test_a_folder_of_another_software_or_dataset(train, finished, tmp_path, key):
    out = tmp_path / "out"
    shutil.copytree(finished, out)
    head = yaml.safe_load((out / "training.yaml").read_text())
    (out / "training.yaml").write_text(yaml.safe_dump(head | {key: "other"}))
    with pytest.raises(UsageError, match=f"begun with {key} other, here it is"):
        train(out)


def test_a_network_that_was_edited_meanwhile(train, cfgs, tmp_path, monkeypatch):
    cfg, out = tmp_path / "own.cfg", tmp_path / "out"
    text = (cfgs / "tiny.cfg").read_text()
    cfg.write_text(text)
    interrupt(monkeypatch, 1, signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train(out, model=str(cfg))
    monkeypatch.undo()
    before = files(out)
    cfg.write_text(text.replace("activation=leaky", "activation=relu", 1))
    with pytest.raises(UsageError, match=r"begun with cfg .*, here it is .*give a new folder"):
        train(out, model=str(cfg))
    assert files(out) == before
    cfg.write_text("# only said otherwise\n" + text)
    train(out, model=str(cfg))
    assert (out / "own.onnx").exists()


def test_a_damaged_checkpoint(train, finished, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    head = yaml.safe_load((finished / "training.yaml").read_text())
    (out / "training.yaml").write_text(yaml.safe_dump(head | {"complete": False}))
    for content in (b"", b"PK\x03\x04half a file", b"\x80\x02}q\x00."):
        (out / "checkpoint.pt").write_bytes(content)
        with pytest.raises(UsageError, match=r"checkpoint\.pt: damaged; remove it"):
            train(out)
    (out / "checkpoint.pt").unlink()
    train(out)
    assert (out / "tiny.onnx").read_bytes() == (finished / "tiny.onnx").read_bytes()


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ({"classes": "car,lorry"}, "no category 'lorry'; .*allowed: car"),
        ({"classes": "car,truck=car"}, "category 'car' stands there twice"),
        ({"classes": "car,,bus"}, "give names as in car,truck=truck"),
        ({"epochs": 0}, "train: epochs: given 0, allowed: a whole number >= 1"),
        ({"batch": 5000}, "batch: given 5000"),
        ({"model": "yolov9"}, "architecture 'yolov9'.*allowed: yolov2"),
        ({"model": "absent.cfg"}, "absent.cfg: No such file"),
        ({"settings": ("jiter=1",)}, "recipe.jiter: unknown key; did you mean 'jitter'"),
        ({"settings": ("jitter=5",)}, "recipe.jitter: given 5"),
        ({"settings": ("jitter",)}, "--set 'jitter': give KEY=VALUE"),
        ({"settings": ("box_loss=giou",)}, "box_loss: given 'giou', allowed: ciou, squared"),
        ({"size": "320"}, "--size '320': give WIDTHxHEIGHT"),
        ({"settings": ("learning_rate=1e9",)}, "learning_rate: given 1000000000"),
    ],
)
def test_bad_input(train, tmp_path, plain, message):
    with pytest.raises(UsageError, match=message) as error:
        train(tmp_path / "out", **plain)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_class_without_objects(train, data, tmp_path):
    without = tmp_path / "data"
    shutil.copytree(data, without)
    annotations = without / "annotations" / "train.json"
    content = json.loads(annotations.read_text())
    for row in content["annotations"]:
        row["ignore"] |= row["category_id"] == 3
    annotations.write_text(json.dumps(content))
    with pytest.raises(UsageError, match="no 'bus' to learn from in its training images"):
        train(tmp_path / "out", data=without, classes="car,bus")


def test_a_size_that_the_network_cannot_have(train, tmp_path):
    with pytest.raises(UsageError, match="multiple of the stride"):
        train(tmp_path / "out", model="yolov3-tiny-w25", size="100x100")


def test_a_loss_that_is_no_number(train, tmp_path):
    # Weights change their sign and grow a hundredfold in every step.
    settings = ("learning_rate=10", "weight_decay=10", "warmup_epochs=0")
    with pytest.raises(UsageError, match=r"not finite in epoch \d+; .*--set learning_rate=2\.5"):
        train(tmp_path / "out", settings=settings, epochs=40, validate_every=0)


def test_no_dataset(train, data, tmp_path):
    with pytest.raises(UsageError, match=r"no dataset, dataset\.yaml is missing"):
        train(tmp_path / "out", data=tmp_path)
    begun = tmp_path / "begun"
    shutil.copytree(data, begun)
    head = yaml.safe_load((begun / "dataset.yaml").read_text())
    (begun / "dataset.yaml").write_text(yaml.safe_dump(head | {"complete": False}))
    with pytest.raises(UsageError, match=r"not complete; 'twin dataset .*begun' goes on"):
        train(tmp_path / "out", data=begun)
    (begun / "dataset.yaml").write_text("a: [")
    with pytest.raises(UsageError, match=r"dataset\.yaml"):
        train(tmp_path / "out", data=begun)
    (begun / "dataset.yaml").write_text("a: 1")
    with pytest.raises(UsageError, match="not what 'twin dataset' writes"):
        train(tmp_path / "out", data=begun)
    recipe = {key: value for key, value in head["recipe"].items() if key != "cameras"}
    (begun / "dataset.yaml").write_text(yaml.safe_dump(head | {"recipe": recipe}))
    with pytest.raises(UsageError, match=r"dataset\.yaml: not what 'twin dataset' writes") as error:
        train(tmp_path / "out", data=begun)
    assert "\n" not in str(error.value)


def test_a_damaged_dataset(train, data, tmp_path):
    broken = tmp_path / "data"
    shutil.copytree(data, broken)
    (broken / "images" / "train" / "000003.jpg").write_bytes(b"no image")
    with pytest.raises(UsageError, match=r"000003\.jpg: no picture that can be read"):
        train(tmp_path / "out", data=broken)
    annotations = broken / "annotations" / "train.json"
    whole = json.loads(annotations.read_text())
    annotations.write_text(json.dumps(whole)[:-20])
    with pytest.raises(UsageError, match=r"train\.json: not an annotation file"):
        train(tmp_path / "out2", data=broken)
    annotations.write_text(json.dumps(whole | {"images": []}))
    with pytest.raises(UsageError, match="no images in train"):
        train(tmp_path / "out2", data=broken)
    annotations.write_text(json.dumps(whole | {"images": whole["images"][1:]}))
    with pytest.raises(UsageError, match="is of no image; damaged"):
        train(tmp_path / "out2", data=broken)
    annotations.unlink()
    with pytest.raises(UsageError, match=r"train\.json: No such file"):
        train(tmp_path / "out2", data=broken)


def test_a_folder_with_something_else(train, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"exists and holds no training\.yaml; give a new folder"):
        train(tmp_path)
    assert set(files(tmp_path)) == {"notes.txt"}


@pytest.mark.parametrize("text", ["format: 1\n", "format: 1\nparameters: []\n", "[]\n"])
def test_a_head_without_parameters(train, tmp_path, text):
    (tmp_path / "training.yaml").write_text(text)
    with pytest.raises(
        UsageError, match=r"training\.yaml: not what 'devkit train' writes"
    ) as error:
        train(tmp_path)
    assert "\n" not in str(error.value)
    assert files(tmp_path) == {"training.yaml": text.encode()}


def test_a_device_that_is_not_here(data, tmp_path):
    for device in ("cuda:99", "gpu"):
        plain = {"model": "yolov2-tiny-w25"}
        request = TrainingRequest(data=data, out=tmp_path / "out", plain=plain, device=device)
        with pytest.raises(UsageError, match=device):
            run_training(request)


# --- as users call it -----------------------------------------------------------------------------


def devkit(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "devkit", *map(str, arguments)],
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip


def test_the_command(data, finished, cfgs, tmp_path):
    out = tmp_path / "out"
    done = devkit(
        "train", data, "--out", out, "--model", cfgs / "tiny.cfg", "--classes", CLASSES,
        "--epochs", 4, "--batch", 8, "--threads", 1, "--validate-every", 2,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert f"{out}/tiny.onnx: scores in {out}/MODEL.md" in done.stdout
    assert "held_out: mAP@0.5" in done.stdout
    assert "train: 8 of 8 steps" in done.stderr
    assert "train: epoch 4: loss" in done.stderr
    assert (out / "tiny.onnx").read_bytes() == (finished / "tiny.onnx").read_bytes()
    refused = devkit("train", data, "--out", tmp_path / "new")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "give --model" in refused.stderr


def test_the_scores_of_a_model(data, finished):
    model = finished / "tiny.onnx"
    done = devkit("evaluate", model, data, "--output", "json", "--runtime", "opencv")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    stored = json.loads((finished / "scores.json").read_text())["held_out"]
    assert {key: found[key] for key in stored} == stored
    human = devkit("evaluate", model, data, "--split", "train", "--runtime", "onnxruntime")
    assert human.returncode == 0
    assert "| all | 16 |" in human.stdout
    assert "| longer side [px] | car | pedestrian |" in human.stdout
    for arguments, message in (
        (("--split", "other_scene"), "no images in other_scene"),
        (("--classes", "car,truck"), "no class 'truck'"),
        (("--split", "all"), ""),
    ):
        done = devkit("evaluate", model, data, *arguments)
        assert (done.returncode == 2) is bool(message)
        assert message in done.stderr


def test_without_torch_it_says_what_to_install(data, tmp_path):
    hidden = (
        "import importlib.util as u, sys; f = u.find_spec;"
        "u.find_spec = lambda n, *a: None if n == 'torch' else f(n, *a);"
        f"sys.argv = ['devkit', 'train', {str(data)!r}, '--out', {str(tmp_path / 'out')!r}];"
        "from devkit.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", hidden], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == (
        "devkit: training needs torch; install it with: pip install 'drivetwin[train]'; "
        "see docs/training.md\n"
    )


def test_devkit_itself_needs_no_torch():
    names = "devkit.cli, devkit.detector.scoring, devkit.detector.score_tables"
    code = f"import sys, {names}; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n"
