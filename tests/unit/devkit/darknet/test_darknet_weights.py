"""devkit.darknet.weights: headers, exact sizes, and files of another network."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from darknet_oracle import random_weights

from devkit.darknet.sections import DarknetError
from devkit.darknet.variant import architecture_network
from devkit.darknet.weights import float_count, read_weights, write_weights

NETWORK = architecture_network("yolov3-tiny-w25", classes=2, width=64, height=64)


def file_of(path, version=(0, 2, 5)):
    written = random_weights(NETWORK, 7, version)
    write_weights(path, NETWORK, written)
    return written


@pytest.mark.parametrize(("version", "header"), [((0, 1, 0), 16), ((0, 2, 0), 20), ((1, 0, 0), 20)])
def test_every_number_comes_back_behind_either_header(tmp_path, version, header):
    path = tmp_path / "a.weights"
    written = file_of(path, version)
    floats = sum(map(float_count, NETWORK.convolutions()))
    assert path.stat().st_size == header + 4 * floats
    read = read_weights(path, NETWORK)
    assert (read.version, read.seen) == (version, 12345)
    for index, numbers in written.convolutions.items():
        for part in ("kernels", "biases", "scales", "means", "variances"):
            expected, found = getattr(numbers, part), getattr(read.convolutions[index], part)
            assert (expected is None) == (found is None)
            assert expected is None or np.array_equal(expected, found)


def refused(path) -> str:
    with pytest.raises(DarknetError) as caught:
        read_weights(path, NETWORK)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_truncated_file_names_the_layer(tmp_path):
    path = tmp_path / "a.weights"
    file_of(path)
    data = path.read_bytes()
    for layer in NETWORK.convolutions():
        before = [other for other in NETWORK.convolutions() if other.index < layer.index]
        begin = 20 + 4 * sum(map(float_count, before))
        for end in (begin, begin + 4 * float_count(layer) - 1):
            path.write_bytes(data[:end])
            line = refused(path)
            assert f"ends in {layer.label}, line {layer.line} of yolov3-tiny" in line
            assert f"it needs {4 * float_count(layer)} bytes, {end - begin} are left" in line


@pytest.mark.parametrize("extra", [1, 4, 1000])
def test_a_file_that_is_too_long_names_the_last_layer(tmp_path, extra):
    path = tmp_path / "a.weights"
    file_of(path)
    path.write_bytes(path.read_bytes() + bytes(extra))
    line = f"{extra} bytes are left behind the last one, layer 22 [convolutional]"
    assert line in refused(path)


def test_damaged_numbers_name_the_layer(tmp_path):
    path = tmp_path / "a.weights"
    file_of(path)
    data = bytearray(path.read_bytes())
    data[-4:] = struct.pack("<f", float("nan"))
    path.write_bytes(data)
    assert "layer 22 [convolutional] holds numbers that are not finite" in refused(path)
    data[20 + 12 * 4 : 20 + 13 * 4] = struct.pack("<f", -0.1)  # 4 filters: the first variance
    path.write_bytes(data)
    assert "layer 0 [convolutional] has a negative variance" in refused(path)


def test_files_that_are_no_weights(tmp_path):
    path = tmp_path / "a.weights"
    assert "No such file" in refused(path)
    path.write_bytes(bytes(15))
    assert "15 bytes, no Darknet header" in refused(path)
    path.write_bytes(struct.pack("<iiiq", 0, 2, 0, 0)[:19])
    assert "19 bytes, ends in the header" in refused(path)
    path.write_bytes(b"\x80\x02\x8a\x0a" * 10)
    assert "in the header; no Darknet weights" in refused(path)
