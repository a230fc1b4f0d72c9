"""Compressed meshes and pictures of glTF files: meshopt, KTX 2 and WebP."""

from __future__ import annotations

import base64
import io
import json
import struct
import sys

import numpy as np
import pytest
from PIL import Image
from unit.twin.world.meshes.gltf.gltf_files import SQUARE, GltfFile

from twin.world.meshes.gltf import ktx2
from twin.world.meshes.mesh_file import load_mesh

COLORS = np.array([[200, 40, 40], [40, 160, 40], [40, 40, 200], [120, 120, 120]], np.uint8)
"""Of the four quarters of a picture, row by row."""

ETC1S = base64.b64decode(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAACwAAACUAAAAJAAAALgAAAAAAAAA"
    "kwAAAAAAAABLAQAAAAAAAAIAAAAAAAAAAAAAAAAAAAAsAAAAAAAAAAIAKACjAQIAAwMAAAgAAAAAAAAAAAA/AAAAAAAAAAAA"
    "/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVyc2FsIDIuMTAAAAQAAwAzAAAADQAAACsAAAAAAAAAAAAAAAAAAAACAAAA"
    "AAAAAAAAAAAfQBQAAQAAQBC0PE2vF8AUAAEAAAAQtNuBFsCUAAAAAAAAMkCGAEwBAAAAAIBAWhQ82yFUVVVVBQAAAKiqqqoC"
    "AMFEAAAAAAAA8l9NAJgAAAAAAABAIAAmAAgAAABAoDgAmAAAAAAAAEAAAdQD"
)
"""A picture of 8 x 8 px whose quarters have :data:`COLORS`, within 3 of 255."""


def uastc(size=(8, 8)):
    """A KTX 2 file of 8 x 8 px: four blocks of one colour each (mode 8: its code in 5 bits, then
    RGBA), without supercompression."""
    blocks = b""
    for red, green, blue in COLORS.tolist():
        bits = 0x17 | red << 5 | green << 13 | blue << 21 | 255 << 29
        blocks += bits.to_bytes(16, "little")
    description = struct.pack(
        "<3I4B4B8B", 44, 0, 40 << 16 | 2, 166, 1, 2, 0, 3, 3, 0, 0, 16, *[0] * 7
    )
    description += struct.pack("<HBB3I", 0, 127, 0, 0, 0, 0xFFFFFFFF)
    start = 80 + 24
    place = start + len(description) + (-(start + len(description)) % 16)
    head = ktx2.SIGNATURE + struct.pack("<9I", 0, 1, *size, 0, 0, 1, 1, 0)
    head += struct.pack("<4I2Q", start, len(description), 0, 0, 0, 0)
    head += struct.pack("<3Q", place, len(blocks), len(blocks))
    return (head + description).ljust(place, b"\0") + blocks


def quarters(image):
    return image[[2, 2, 5, 5], [2, 5, 2, 5]].astype(int)


def textured(file, data, mime, extension):
    """A square with a picture that only an extension names."""
    file.tree["images"] = [{"bufferView": file.view(data), "mimeType": mime}]
    file.tree["textures"] = [{"extensions": {extension: {"source": 0}}}]
    info = {"baseColorTexture": {"index": 0}}
    file.tree["materials"] = [{"pbrMetallicRoughness": info, "doubleSided": True}]
    file.tree["extensionsUsed"] = file.tree["extensionsRequired"] = [extension]
    row = file.primitive(material=0)
    row["attributes"]["TEXCOORD_0"] = file.accessor(SQUARE[:, :2] / 2)


def refused(path, *expected):
    with pytest.raises(ValueError) as error:
        load_mesh(path)
    text = str(error.value)
    assert path.name in text
    assert "\n" not in text
    for words in expected:
        assert words in text, text


@pytest.mark.parametrize(("data", "near"), [(uastc(), 0), (ETC1S, 3)], ids=["uastc", "etc1s"])
def test_ktx2_pictures(tmp_path, data, near):
    pytest.importorskip("opengl_basisu", reason="opengl_basisu is not installed")
    file = GltfFile()
    textured(file, data, "image/ktx2", "KHR_texture_basisu")
    loaded = load_mesh(file.write(tmp_path / "m.glb"))
    assert loaded.notes == []
    (part,) = loaded.parts
    assert part.image.shape == (8, 8, 3)
    assert np.abs(quarters(part.image) - COLORS).max() <= near
    np.testing.assert_allclose(part.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])


def test_a_plain_picture_is_taken_before_a_ktx2_one(tmp_path):
    """So pictures do not depend on what is installed."""
    file = GltfFile()
    textured(file, b"no picture", "image/ktx2", "KHR_texture_basisu")
    out = io.BytesIO()
    Image.new("RGB", (4, 4), (9, 8, 7)).save(out, "PNG")
    file.tree["images"].append({"bufferView": file.view(out.getvalue()), "mimeType": "image/png"})
    file.tree["textures"][0]["source"] = 1
    (part,) = load_mesh(file.write(tmp_path / "m.glb")).parts
    assert part.image[0, 0].tolist() == [9, 8, 7]


def test_broken_and_oversized_ktx2_pictures_are_one_line(tmp_path):
    pytest.importorskip("opengl_basisu", reason="opengl_basisu is not installed")
    for data, expected in (
        (uastc()[:-40], "images[0]:"),
        (ETC1S[:200], "images[0]:"),
        (uastc((1 << 16, 1 << 16)), "images[0]:"),
        (uastc()[:12] + struct.pack("<I", 37) + uastc()[16:], "vkFormat 37"),
    ):
        file = GltfFile()
        textured(file, data, "image/ktx2", "KHR_texture_basisu")
        refused(file.write(tmp_path / "m.glb"), "a texture cannot be read", expected)
    with pytest.raises(ValueError, match="8 x 8 px"):
        ktx2.read_ktx2(uastc(), 63)


def test_without_the_library_of_ktx2(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    file = GltfFile()
    textured(file, uastc(), "image/ktx2", "KHR_texture_basisu")
    refused(file.write(tmp_path / "m.glb"), "KTX 2: install drivetwin[gltf], or export PNG or JPEG")


def test_webp_pictures(tmp_path):
    out = io.BytesIO()
    picture = np.repeat(np.repeat(COLORS.reshape(2, 2, 3), 4, axis=0), 4, axis=1)
    Image.fromarray(picture).save(out, "WEBP", lossless=True)
    file = GltfFile()
    textured(file, out.getvalue(), "image/webp", "EXT_texture_webp")
    loaded = load_mesh(file.write(tmp_path / "m.glb"))
    assert loaded.notes == []
    np.testing.assert_array_equal(loaded.parts[0].image, picture)


class Packed:
    """A glTF file beside two buffers: compressed bytes, and a placeholder for the plain ones."""

    def __init__(self, extension="EXT_meshopt_compression"):
        self.file = GltfFile()
        self.extension = extension
        self.plain = 0

    def accessor(self, values, dtype, mode, done="NONE", data=None, row=None, **more):
        """Add a compressed array; ``data``: of another encoder than the plain one."""
        meshopt = pytest.importorskip("meshopt", reason="meshopt is not installed")
        number = self.file.accessor(values, dtype, **more)
        array = np.asarray(values, f"<{dtype}")
        row = row or array.nbytes // len(array)
        data = data if data is not None else meshopt.encode_gltf_buffer(array, mode)
        view = self.file.tree["bufferViews"][self.file.tree["accessors"][number]["bufferView"]]
        start = len(self.file.bytes) + (-len(self.file.bytes) % 4)
        self.file.bytes = self.file.bytes.ljust(start, b"\0") + data
        packed = {"buffer": 0, "byteOffset": start, "byteLength": len(data), "byteStride": row}
        packed |= {"count": len(array), "mode": mode, "filter": done}
        length = len(array) * row
        view |= {"buffer": 1, "byteOffset": self.plain, "byteLength": length}
        if mode == "ATTRIBUTES":
            view["byteStride"] = row
        view["extensions"] = {self.extension: packed}
        self.plain += length
        return number

    def square(self, **positions):
        """The square, its positions and corners compressed."""
        values = {"values": SQUARE, "dtype": "f4", **positions}
        points = self.accessor(mode="ATTRIBUTES", **values)
        corners = self.accessor([0, 1, 2, 0, 2, 3], "u2", "TRIANGLES")
        row = {"attributes": {"POSITION": points}, "indices": corners}
        self.file.tree["meshes"][0]["primitives"].append(row)
        return row

    def write(self, path, copy=None):
        """``copy``: plain bytes of the second buffer."""
        tree = {**self.file.tree, "extensionsRequired": [self.extension]}
        first = {"byteLength": len(self.file.bytes), "uri": "m.bin"}
        second = {"byteLength": self.plain}
        if copy is not None:
            (path.parent / "copy.bin").write_bytes(copy)
            second["uri"] = "copy.bin"
        (path.parent / "m.bin").write_bytes(self.file.bytes)
        path.write_text(json.dumps({**tree, "buffers": [first, second]}))
        return path


def triangles(path):
    data = load_mesh(path)
    assert data.notes == []
    return np.concatenate([part.points[part.faces] for part in data.parts])


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_positions_and_triangles(tmp_path, extension):
    packed = Packed(extension)
    packed.square()
    found = triangles(packed.write(tmp_path / "m.gltf"))
    # The codec may turn a triangle, and keeps its side.
    np.testing.assert_array_equal(
        np.sort(found, axis=1), np.sort(SQUARE[[[0, 1, 2], [0, 2, 3]]], axis=1)
    )
    assert (np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2] > 0).all()


def test_meshopt_indices_of_strips_and_quantized_positions(tmp_path):
    packed = Packed()
    row = packed.square(values=np.pad(SQUARE * 100, ((0, 0), (0, 1))).astype(int), dtype="u2")
    file = packed.file
    accessor = file.tree["accessors"][row["attributes"]["POSITION"]]
    accessor |= {"type": "VEC3"}  # rows of 8 bytes, of which 6 are used
    row |= {"mode": 5, "indices": packed.accessor([0, 1, 3, 2], "u2", "INDICES")}
    found = triangles(packed.write(tmp_path / "m.gltf"))
    np.testing.assert_array_equal(found, 100 * SQUARE[[[0, 1, 3], [1, 2, 3]]])


def test_meshopt_filter_of_floats(tmp_path):
    meshopt = pytest.importorskip("meshopt", reason="meshopt is not installed")
    points = SQUARE / 3
    data = meshopt.encode_vertex_buffer_level(meshopt.encode_filter_exp(points, 15), 2, 0)
    packed = Packed()
    packed.square(values=points, done="EXPONENTIAL", data=data)
    found = triangles(packed.write(tmp_path / "m.gltf"))
    assert (
        np.abs(np.sort(found, axis=1) - np.sort(points[[[0, 1, 2], [0, 2, 3]]], axis=1)).max()
        < 1e-4
    )


def test_an_uncompressed_copy_is_taken_without_the_library(tmp_path, monkeypatch):
    packed = Packed()
    packed.square()
    corners = np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    path = packed.write(tmp_path / "m.gltf", SQUARE.tobytes() + corners)
    monkeypatch.setitem(sys.modules, "meshopt", None)
    np.testing.assert_array_equal(triangles(path), SQUARE[[[0, 1, 2], [0, 2, 3]]])
    refused(packed.write(path), "(EXT_meshopt_compression): install drivetwin[gltf], or export")


BROKEN = {
    "cut off": ("byteLength", 9, "bufferViews[0] is compressed (EXT_meshopt_compression): "),
    "row": ("byteStride", 7, "mode ATTRIBUTES with rows of 7 bytes"),
    "mode": ("mode", "WORDS", "mode WORDS with rows of 12 bytes"),
    "filter": ("filter", "HAZE", "bufferViews[0] is compressed (EXT_meshopt_compression): "),
    "huge": ("count", 10**9, "1000000000 rows of 12 bytes, together at most"),
    "few": ("count", 3, "bufferViews[0] unpacks to 36 bytes, fewer than it says"),
    "none": ("count", 0, "bufferViews[0] unpacks to 0 bytes, fewer than it says"),
    "beyond": ("byteOffset", 10**6, "bufferViews[0], compressed, ends beyond its buffer"),
    "buffer": ("buffer", 2, "buffers[2] is named, but there are 2"),
    "word": ("count", "four", "'count' is four, needed a whole number"),
}


@pytest.mark.parametrize("how", BROKEN)
def test_broken_meshopt_data_are_one_line(tmp_path, how):
    key, value, expected = BROKEN[how]
    packed = Packed()
    packed.square()
    packed.file.tree["bufferViews"][0]["extensions"][packed.extension][key] = value
    refused(packed.write(tmp_path / "m.gltf"), expected)
