"""``devkit import-darknet``, ``darknet-cfg``, ``detect`` and ``parity`` as users call them."""

from __future__ import annotations

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
from darknet_oracle import random_weights
from typer.testing import CliRunner
from waiting import PATIENCE_S

from devkit.cli import app
from devkit.darknet.build import read_network
from devkit.darknet.weights import write_weights
from devkit.detector.detector import Detector
from devkit.detector.model_files import shipped_models
from twin.base.errors import UsageError


def devkit(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "devkit", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A cfg as printed, weights that fit it, names."""
    folder = tmp_path_factory.mktemp("darknet")
    size = ("--classes", 3, "--width", 160, "--height", 96)
    printed = devkit("darknet-cfg", "yolov2-tiny-w25", *size)
    assert printed.returncode == 0
    (folder / "a.cfg").write_text(printed.stdout)
    network = read_network(folder / "a.cfg")
    write_weights(folder / "a.weights", network, random_weights(network, 5))
    (folder / "a.names").write_text("car\ntruck\n\npedestrian\n")
    return folder


def test_import_and_detect(files):
    out = files / "a.onnx"
    done = devkit(
        "import-darknet", files / "a.cfg", files / "a.weights", "--out", out,
        "--names", files / "a.names", "--output", "json",
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    told = json.loads(done.stdout)
    assert (told["width"], told["height"]) == (160, 96)
    assert told["classes"] == ["car", "truck", "pedestrian"]
    assert told["seen"] == 12345
    image = np.random.default_rng(1).integers(0, 256, (90, 160, 3), dtype=np.uint8)
    cv2.imwrite(str(files / "a.png"), image[..., ::-1])
    seen = devkit("detect", out, files / "a.png", "--confidence-min", "0.05", "--output", "json")
    assert (seen.returncode, seen.stderr) == (0, "")
    found = json.loads(seen.stdout)["detections"]
    own = Detector(out).detect(image[None])
    assert len(found) >= len(own.of(0))
    assert all(d["confidence"] >= 0.05 for d in found)
    assert len(found) > 0
    assert (
        f"{len(found)} objects"
        in devkit("detect", out, files / "a.png", "--confidence-min", "0.05").stdout
    )
    half = devkit("detect", out, files / "a.png", files / "a.cfg", files / "a.png")
    assert half.returncode == 2
    assert "a.cfg: no picture" in half.stderr
    assert half.stdout.count("a.png: ") == 1, "what was seen before it is told"


def test_another_input_size(files):
    done = devkit(
        "import-darknet", files / "a.cfg", files / "a.weights", "--out", files / "b.onnx",
        "--names", files / "a.names", "--width", 320, "--height", 192,
    )  # fmt: skip
    assert done.returncode == 0
    assert "16 layers" in done.stdout
    assert "a.cfg: no picture" in refused("detect", files / "b.onnx", files / "a.cfg")
    assert "input 320x192, 3 classes" in done.stdout
    description = Detector(files / "b.onnx").description
    assert (description.width, description.height) == (320, 192)


def refused(*arguments: object) -> str:
    """The line of a command that is called in this process, which takes a tenth of the time."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert isinstance(done.exception, UsageError), (done.output, done.exception)
    assert done.stdout == ""
    line = str(done.exception)
    assert "\n" not in line
    return line


def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(files):
    cfg, weights, names, out = (files / n for n in ("a.cfg", "a.weights", "a.names", "c.onnx"))
    short, few = files / "short.weights", files / "few.names"
    short.write_bytes(weights.read_bytes()[:-4])
    few.write_text("car\n")
    line = refused("import-darknet", cfg, short, "--out", out, "--names", names)
    assert "short.weights: ends in layer 14 [convolutional], line" in line
    line = refused("import-darknet", cfg, weights, "--out", out)
    assert "a.cfg: 3 classes without names; give --names FILE" in line
    line = refused("import-darknet", cfg, weights, "--out", out, "--names", few)
    assert "few.names: 1 names" in line
    line = refused("import-darknet", cfg, weights, "--out", out, "--names", weights)
    assert "a.weights: not a text file of names" in line
    line = refused("import-darknet", weights, weights, "--out", out)
    assert "a.weights: not a Darknet cfg" in line
    line = refused("import-darknet", cfg, weights, "--out", files / "c.bin", "--names", names)
    assert "expected a name that ends in .onnx" in line
    assert not out.exists()
    assert not [path for path in files.iterdir() if path.name.startswith(".")]
    assert "architecture 'yolov9'" in refused("darknet-cfg", "yolov9")
    assert "c.onnx: No such file" in refused("detect", out, cfg)


def test_parity(tmp_path):
    name = "batch_1/aeb_metrics_sim_inst_1.csv"
    header = "Timestamp,Model,Label,Confidence (%),Size (px^2),AEB (bool)\n"
    log = tmp_path / "batch_1" / "aeb_metrics_sim_inst_1.csv"
    log.parent.mkdir()
    log.write_text(header + "t,yolov2,car,70,1200,1\nt,yolov2,,0.0,,0\nt,yolov2,car,70,,1\n")
    done = devkit("parity", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        "2 / 2 rows agree, in 1 logs",
        "  yolov2: 2 / 2",
        f"{name}:4: not judged: a box without Size (px^2)",
    ]
    log.write_text(log.read_text() + "t,yolov2,car,70,1200,0\n")
    done = devkit("parity", tmp_path)
    assert done.returncode == 1
    assert "2 / 3 rows agree" in done.stdout
    assert f"{name}:5: car 70 % 1200 px^2: logged AEB 0, the rule says 1" in done.stdout
    told = json.loads(devkit("parity", tmp_path, "--output", "json").stdout)
    assert (told["rows"], told["agreeing"]) == (3, 2)
    assert told["disagreements"][0]["line"] == 5
    assert told["unreadable"][0]["line"] == 4
    assert "no such folder" in refused("parity", tmp_path / "none")


def test_detect_and_evaluate_take_the_names_of_shipped_models(files, tmp_path):
    image = tmp_path / "grey.png"
    cv2.imwrite(str(image), np.full((96, 160, 3), 128, np.uint8))
    name = next(iter(shipped_models()))
    seen = devkit("detect", name, image)
    assert (seen.returncode, seen.stderr) == (0, "")
    assert seen.stdout.startswith(f"{image}: ")
    (tmp_path / "none.png").write_bytes(b"no picture")
    seen = devkit("detect", name, image, tmp_path / "none.png", image)
    assert (seen.returncode, len(seen.stderr.splitlines())) == (2, 1)
    assert seen.stdout.startswith(f"{image}: "), "those before it are told"
    assert "none.png: " in seen.stderr
    line = refused("detect", f"{name}x", image)
    assert f"no such model is shipped; did you mean '{name}'?" in line
    line = refused("evaluate", name, tmp_path / "none")
    assert "none" in line
    assert name not in line, "the model was found"
