"""``devkit quantize --score``: both networks on one dataset."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from dark_spots import write_dark_spots
from tiny_networks import write_dark_spot_detector
from typer.testing import CliRunner

from devkit.cli import app
from devkit.detector.integer import command
from twin.base.errors import EXIT_FAILED, EXIT_PASS


@pytest.fixture
def dataset(tmp_path) -> Path:
    return write_dark_spots(tmp_path / "data")


def test_both_are_scored_on_what_training_does_not_see(tmp_path, dataset):
    path = write_dark_spot_detector(tmp_path / "spots.onnx")
    words = ["quantize", path, "-o", tmp_path / "n.integer", "--calibrate", dataset]
    words += ["--score", dataset, "--check", "--output", "json"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == EXIT_PASS, done.exception
    told = json.loads(done.stdout)
    assert "16 pictures" in told["origin"]
    for name in ("float", "integer"):
        assert told[name]["map50"] == told[name]["classes"]["car"] == 1.0
        assert told[name]["picture_ms"] > 0


def test_check_fails_where_more_is_lost_than_may_be(tmp_path, dataset, monkeypatch):
    monkeypatch.setattr(command, "LOSS_MAX_POINTS", -0.5)
    path, out = write_dark_spot_detector(tmp_path / "spots.onnx"), tmp_path / "n.integer"
    words = ["quantize", path, "-o", out, "--calibrate", dataset, "--score", dataset]
    for extra, code in (([], EXIT_PASS), (["--check"], EXIT_FAILED)):
        done = CliRunner().invoke(app, [str(word) for word in words + extra])
        assert done.exit_code == code
        assert "integer loses 0.00 points of mAP" in done.stdout
