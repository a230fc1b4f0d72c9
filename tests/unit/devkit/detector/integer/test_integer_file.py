"""Files of integer networks that are damaged, or made to read and write where they must not."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from integer_networks import (
    PLAIN,
    WHOLE,
    convolution,
    described,
    head,
    network,
    pictures,
    write_network,
)

from devkit.detector.detector import Detector
from devkit.detector.integer import network_file
from devkit.detector.integer.network_file import encode_network, read_network
from devkit.detector.integer.steps import (
    IntegerHead,
    IntegerJoin,
    IntegerPool,
    IntegerSum,
    JoinPart,
    Windows,
)
from devkit.detector.runtime import ModelError
from twin.base.errors import EXIT_USAGE

FIRST = convolution(0, 3, 4)
replace = msgspec.structs.replace


def sound():
    return network(FIRST, IntegerPool(1, Windows(2, 2, (0, 0, 0, 0))), head(2, 4))


def refusal(path) -> str:
    with pytest.raises(ModelError) as caught:
        Detector(path)
    line = str(caught.value)
    assert line.startswith(str(path))
    assert "\n" not in line
    assert caught.value.exit_code == EXIT_USAGE
    return line


def test_a_file_is_read_as_it_was_written(tmp_path):
    path = write_network(tmp_path / "n.integer", sound())
    made, description, shapes = read_network(path)
    assert made == sound()
    assert description == described()
    assert [(s.rows, s.columns, s.channels) for s in shapes][2:] == [(4, 4, 4), (4, 4, 6)]
    assert encode_network(made) == path.read_bytes()


def test_what_is_no_such_file_is_one_line(tmp_path):
    path = tmp_path / "n.integer"
    assert "No such file" in refusal(path)
    path.mkdir()
    refusal(path)
    path.rmdir()
    for content in (b"", b"\x80", b"\x93NUMPY", b"{}", b"\xc1" * 100, b"\x91" * 100_000):
        path.write_bytes(content)
        assert "not an integer network, or damaged" in refusal(path)


def test_a_file_cut_anywhere_is_refused(tmp_path):
    path, data = tmp_path / "n.integer", encode_network(sound())
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        refusal(path)


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    path = write_network(tmp_path / "n.integer", sound())
    monkeypatch.setattr(network_file, "FILE_BYTES_MAX", 100)
    refusal(path)


def test_a_flipped_byte_is_refused_or_still_stays_within_its_maps(tmp_path):
    path, data = tmp_path / "n.integer", encode_network(sound())
    rng = np.random.default_rng(1)
    refused = 0
    for place in rng.integers(0, len(data), 300).tolist():
        broken = bytearray(data)
        broken[place] ^= int(rng.integers(1, 256))
        path.write_bytes(broken)
        try:
            read_network(path)
        except ModelError:
            refused += 1
    assert 30 < refused < 300


def wide_head(given: int, channels: int, size: int, pads: int = 15) -> IntegerHead:
    """A head of one channel with large windows."""
    windows = Windows(size, 1, (pads,) * 4)
    kernels = bytes(size * size * channels)
    return IntegerHead(given, windows, 1, kernels, bytes(4), bytes(8), "head")


WILD = {
    "reads a map that comes later": (network(replace(FIRST, given=1), head(1, 4)), "step 1: reads"),
    "reads itself": (network(FIRST, IntegerPool(2, PLAIN), head(2, 4)), "step 2: reads map 2"),
    "reads sums": (network(head(0, 3), head(1, 6)), "step 2: reads map 1"),
    "kernels too short": (
        network(replace(FIRST, kernels=FIRST.kernels[:-1]), head(1, 4)),
        "step 1: kernels: 107 bytes, expected 108",
    ),
    "more channels than kernels": (
        network(replace(FIRST, outs=5), head(1, 5)),
        "step 1: kernels: 108 bytes, expected 135",
    ),
    "biases too long": (
        network(replace(FIRST, biases=bytes(20)), head(1, 4)),
        "biases: 20 bytes, expected 16",
    ),
    "shifts of nothing": (
        network(replace(FIRST, shifts=bytes(4)), head(1, 4)),
        "shifts: 0 to 0, allowed: 1 to 62",
    ),
    "shifts beyond the word": (
        network(replace(FIRST, shifts=bytes([63] * 4)), head(1, 4)),
        "shifts: 63 to 63, allowed: 1 to 62",
    ),
    "negative factor": (
        network(replace(FIRST, positive=b"\xff" * 16), head(1, 4)),
        "positive: below 0",
    ),
    "a level that has no opposite": (
        network(replace(FIRST, kernels=b"\x80" * 108), head(1, 4)),
        "kernels: -128, allowed: -127 to 127",
    ),
    "sums that overflow": (
        network(replace(FIRST, biases=b"\xff\xff\xff\x7f" * 4), head(1, 4)),
        "its sums may exceed 32 bits",
    ),
    "no window fits": (
        network(
            replace(FIRST, windows=Windows(9, 1, (0, 0, 0, 0)), kernels=bytes(972)), head(1, 4)
        ),
        "step 1: makes a map of 0x0",
    ),
    "windows of border alone": (
        network(replace(FIRST, windows=Windows(3, 1, (3, 0, 0, 0))), head(1, 4)),
        "pads [3, 0, 0, 0] hold whole windows",
    ),
    "pools of border alone": (
        network(FIRST, IntegerPool(1, Windows(2, 2, (0, 0, 2, 0))), head(2, 4)),
        "pads [0, 0, 2, 0] hold whole windows",
    ),
    "sum of two shapes": (
        network(FIRST, IntegerSum(0, 1, (1, 1), 1, 0), head(2, 4)),
        "adds maps of [8, 8, 3] and [8, 8, 4]",
    ),
    "join of two sizes": (
        network(
            FIRST, IntegerJoin([JoinPart(0, 1, 1), JoinPart(1, 1, 1, repeat=2)], 0), head(2, 7)
        ),
        "joins maps of [(8, 8), (16, 16)]",
    ),
    "fold that does not go into it": (
        network(FIRST, IntegerJoin([JoinPart(1, 1, 1, fold=3)], 0), head(2, 36)),
        "folds 3x3 of 8x8x4",
    ),
    "scales that are no numbers": (
        network(replace(head(0, 3), scales=np.full(6, np.nan).tobytes())),
        "scales: not finite",
    ),
    "more memory than there is": (
        network(
            FIRST, *[IntegerJoin([JoinPart(n, 1, 1, repeat=32)], 0) for n in (1, 2)], head(3, 4)
        ),
        "levels per image, allowed",
    ),
    "kernels that fill the memory": (
        network(
            IntegerJoin([JoinPart(0, 1, 1)] * 16, 0),
            *[IntegerJoin([JoinPart(n, 1, 1)] * 8, 0) for n in (1, 2)],
            *[wide_head(3, 3072, 16) for _ in range(22)],
            width=8,
            height=8,
        ),
        "its kernels need",
    ),
    "rows that fill the memory": (
        network(
            IntegerJoin([JoinPart(0, 1, 1)] * 16, 0),
            *[IntegerJoin([JoinPart(n, 1, 1)] * 8, 0) for n in (1, 2)],
            wide_head(3, 3072, 32, pads=31),
            width=2600,
            height=1,
        ),
        "its kernels need",
    ),
    "work without an end": (
        network(
            IntegerJoin([JoinPart(0, 1, 1)] * 16, 0),
            IntegerJoin([JoinPart(1, 1, 1)] * 8, 0),
            *[wide_head(2, 384, 16) for _ in range(3)],
            width=256,
            height=256,
        ),
        "products per image",
    ),
    "no such output": (network(head(0, 3, output="other")), "no step makes 'head'"),
    "another number of channels": (network(head(0, 3, outs=7)), "expected [batch, 6, rows"),
    "input of another size": (
        replace(
            network(FIRST, IntegerPool(1, Windows(8, 8, (0, 0, 0, 0))), head(2, 4)),
            description=described(4, 4).encode(),
        ),
        "step 2: makes a map of 0x0",
    ),
    "a description of nothing": (
        replace(network(head(0, 3)), description="[]"),
        "damaged: description",
    ),
}


@pytest.mark.parametrize("case", WILD)
def test_a_network_that_would_leave_its_maps_is_refused(tmp_path, case):
    made, words = WILD[case]
    assert words in refusal(write_network(tmp_path / "n.integer", made))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"v": 2}, "v"),
        ({"format": "another"}, "format"),
        ({"steps": []}, "steps"),
        ({"more": 1}, "more"),
        ({"steps": [{"kind": "loop"}]}, "kind"),
    ],
)
def test_other_versions_and_kinds_are_refused(tmp_path, change, words):
    path = tmp_path / "n.integer"
    plain = msgspec.to_builtins(sound(), builtin_types=(bytes,))
    path.write_bytes(msgspec.msgpack.encode({**plain, **change}))
    assert words in refusal(path)


def test_a_head_of_other_numbers_than_its_layer_is_what_the_file_says(tmp_path):
    steps = IntegerHead(
        0, WHOLE, 6, b"\x01" * 18, b"\x07\0\0\0" * 6, np.arange(6.0).tobytes(), "head"
    )
    path = write_network(tmp_path / "n.integer", network(steps))
    images = pictures(1, 8, 8)
    sums = (images.astype(np.int64) - 128).sum(axis=3) + 7
    raw = Detector(path).raw(images)["head"]
    for channel in range(6):
        np.testing.assert_array_equal(raw[:, channel], (sums * channel).astype(np.float32))
