"""devkit.detector.integer: every kernel against plain NumPy, to the last bit."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from integer_networks import (
    PLAIN,
    WHOLE,
    convolution,
    described,
    head,
    network,
    pictures,
    write_network,
    write_quantized,
)
from integer_oracle import maps

from devkit.darknet.variant import ARCHITECTURES
from devkit.detector.decode import Selection
from devkit.detector.detector import Detector
from devkit.detector.integer.network_file import read_network
from devkit.detector.integer.program import IntegerProgram
from devkit.detector.integer.shapes import map_shapes
from devkit.detector.integer.steps import (
    IntegerHead,
    IntegerJoin,
    IntegerPool,
    IntegerSum,
    JoinPart,
    Windows,
)
from devkit.detector.resize import prepare_kernels
from devkit.images import Images

TESTS = Path(__file__).parents[4]


def computed(made, given: np.ndarray) -> list[np.ndarray]:
    """All maps, by the kernels, of pictures of the network's own size."""
    prepare_kernels()
    count, height, width, _ = given.shape
    shapes = map_shapes(made, described(width, height))
    picture = wp.zeros((count, *shapes[0].stored_shape), dtype=wp.int8, device="cpu")
    picture.numpy()[..., :3] = given.astype(np.int16) - 128
    program = IntegerProgram(made.steps, shapes, picture, None)
    program.run(count)
    return [program.levels(number) for number in range(len(shapes))]


def agree(made, given: np.ndarray) -> list[np.ndarray]:
    """Maps of kernels and NumPy are the same; those of the kernels."""
    found = computed(made, given)
    for number, (one, other) in enumerate(zip(found, maps(made, given), strict=True)):
        assert one.shape == other.shape, number
        np.testing.assert_array_equal(one, other, err_msg=f"map {number}")
    return found


@pytest.mark.parametrize("outs", [1, 4, 15, 16, 17, 45])
@pytest.mark.parametrize(
    "windows",
    [
        PLAIN,
        WHOLE,
        Windows(3, 2, (1, 1, 1, 1)),
        Windows(3, 2, (0, 0, 1, 1)),
        Windows(2, 2, (0, 0, 0, 0)),
        Windows(5, 3, (2, 1, 0, 4)),
        Windows(8, 8, (0, 0, 0, 0)),
    ],
)
def test_a_convolution_is_that_of_plain_integers(windows, outs):
    made = network(convolution(0, 3, outs, windows, seed=outs), head(1, outs), width=29, height=23)
    found = agree(made, pictures(3, 29, 23))
    assert len(np.unique(found[1])) > 8, "too few levels to say anything"


def test_sums_beyond_float32_are_exact():
    # 2304 products of 127 x 128, far above 2^24, by kernels of one sign and of both.
    rng = np.random.default_rng(5)
    large = np.full((18, 3, 3, 256), 127, np.int8)
    large[1::2] *= rng.choice([-1, 1], large[1::2].shape).astype(np.int8)
    large[2::4, ..., 0] = 126
    first = convolution(0, 3, 256, WHOLE, seed=1)
    sums = IntegerHead(1, PLAIN, 18, large.tobytes(), bytes(72), np.ones(18).tobytes(), "head")
    dark = np.zeros((1, 8, 8, 3), np.uint8)
    given = np.concatenate([dark, dark + 255, pictures(2, 8, 8)])
    found = agree(network(first, sums), given)
    assert np.abs(found[2]).max() > 1 << 24
    odd = found[2][np.abs(found[2]) > 1 << 24] % 2
    assert odd.any(), "no sum that float32 would round"


def test_the_largest_sum_that_is_not_split_is_exact():
    # 1032 products of 127 x 128 are 448 below 2^24: float32 must hold every step of it.
    kernels = np.full((3, 1, 1, 1032), 127, np.int8)
    kernels[1] *= -1
    kernels[2, ..., ::2] = 125
    wide = convolution(0, 3, 1032, WHOLE, seed=3)
    sums = IntegerHead(1, WHOLE, 3, kernels.tobytes(), bytes(12), np.ones(3).tobytes(), "head")
    agree(network(wide, sums), np.concatenate([pictures(2, 8, 8), np.zeros((1, 8, 8, 3), "u1")]))


@pytest.mark.parametrize(
    "windows",
    [
        Windows(2, 2, (0, 0, 0, 0)),
        Windows(2, 1, (0, 0, 1, 1)),
        Windows(3, 2, (1, 1, 1, 1)),
        Windows(5, 1, (2, 2, 2, 2)),
    ],
)
def test_pools_look_at_nothing_beyond_the_border(windows):
    steps = convolution(0, 3, 7, seed=2), IntegerPool(1, windows), head(2, 7)
    agree(network(*steps, width=21, height=13), pictures(2, 21, 13))


def test_sums_and_joins_round_halves_upwards():
    one, two = convolution(0, 3, 8, WHOLE, seed=8), convolution(0, 3, 8, WHOLE, seed=9)
    joined = IntegerJoin(
        [JoinPart(1, 3, 1), JoinPart(2, (1 << 31) - 1, 31), JoinPart(3, 1, 62), JoinPart(0, 1, 2)],
        -3,
    )
    halves = IntegerSum(1, 2, (1, 1), 1, 5)
    wide = IntegerSum(1, 2, (2**31 - 1, -(2**31) + 1), 31, -128)
    agree(network(one, two, halves, wide, joined, head(5, 27)), pictures(2, 8, 8))


def test_joins_repeat_and_fold_as_darknet_does():
    steps = (
        convolution(0, 3, 8, Windows(2, 2, (0, 0, 0, 0)), seed=4),
        IntegerJoin([JoinPart(1, 1 << 30, 30, fold=2)], 0),
        IntegerJoin(
            [
                JoinPart(2, 1 << 30, 30, repeat=4),
                JoinPart(1, 1 << 29, 30, repeat=2),
                JoinPart(0, 1, 1),
            ],
            9,
        ),
        head(3, 43),
    )
    found = agree(network(*steps, width=24, height=16), pictures(2, 24, 16))
    assert found[2].shape[1:] == (4, 6, 32)


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_whole_networks_are_those_of_plain_integers(tmp_path, name):
    path = write_quantized(tmp_path, name)
    made, description, _ = read_network(path)
    images = pictures(3, seed=7)
    expected = maps(made, images)
    raw = Detector(path).raw(images)
    for number, step in enumerate(made.steps, 1):
        if isinstance(step, IntegerHead):
            values = (expected[number] * np.frombuffer(step.scales, "<f8")).astype(np.float32)
            np.testing.assert_array_equal(raw[step.output], values.transpose(0, 3, 1, 2))
    assert set(raw) == {head.output for head in description.heads}


@pytest.mark.parametrize("name", ["yolov2", "yolov3-tiny"])
def test_no_bit_depends_on_batch_place_neighbours_size_or_memory(tmp_path, name):
    path = write_quantized(tmp_path, name)
    images = pictures(64, 200, 120, seed=3)
    host = Detector(path, Selection(confidence_min=0.05))
    placed = Detector(path, Selection(confidence_min=0.05), device="cpu", size_px=(200, 120))
    expected = host.raw(images)
    assert len(host.detect(images).image) > 50
    for detector in (host, placed):
        for batch in (1, 3, 64):
            for first in range(0, 64, batch):
                part = detector.raw(images[first : first + batch])
                for output, values in part.items():
                    np.testing.assert_array_equal(
                        values, expected[output][first : first + batch], strict=True
                    )
    rows = [5, 63, 5, 0, 17]
    for output, values in placed.raw(Images(images, rows)).items():
        np.testing.assert_array_equal(values, expected[output][rows])
    for output, values in host.raw([]).items():
        assert values.shape == (0, *expected[output].shape[1:])


HASH = """
import hashlib, sys
from pathlib import Path
import warp as wp
wp.config.cpu_compiler_flags = sys.argv[2]
from integer_networks import pictures
from devkit.detector.detector import Detector
raw = Detector(Path(sys.argv[1])).raw(pictures(2, seed=5))
print(hashlib.sha256(b"".join(raw[name].tobytes() for name in sorted(raw))).hexdigest())
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="instruction sets of x86")
def test_other_instruction_sets_give_the_same_bits(tmp_path):
    path = write_quantized(tmp_path, "yolov3-tiny")
    found = set()
    for number, flags in enumerate(("-march=native", "-target-cpu haswell", "")):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", HASH, str(path), flags],
            env={
                **os.environ,
                "PYTHONPATH": str(TESTS),
                "WARP_CACHE_PATH": str(tmp_path / str(number)),
            },
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        found.add(done.stdout.split()[-1])
    assert len(found) == 1


def test_a_network_without_steps_between_is_one_head(tmp_path):
    made = network(IntegerHead(0, WHOLE, 6, b"\x01" * 18, bytes(24), np.ones(6).tobytes(), "head"))
    raw = Detector(write_network(tmp_path / "n.integer", made)).raw(pictures(1, 8, 8))
    expected = (pictures(1, 8, 8).astype(np.int64) - 128).sum(axis=3)
    np.testing.assert_array_equal(raw["head"][:, 2], expected)
