"""glTF files as the standard has them: what comes in, what is noted, and what is refused."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest
from PIL import Image
from unit.twin.world.meshes.gltf.gltf_files import SQUARE, GltfFile

from twin.world.meshes.mesh_file import load_mesh


def triangles(path):
    """Corners of all triangles [F, 3, 3], and the notes."""
    data = load_mesh(path)
    return np.concatenate([part.points[part.faces] for part in data.parts]), data.notes


def refused(path, expected):
    with pytest.raises(ValueError) as error:
        load_mesh(path)
    text = str(error.value)
    assert expected in text, text
    assert path.name in text
    assert "\n" not in text


def png(color, size=(4, 4)):
    out = io.BytesIO()
    Image.new("RGB", size, color).save(out, "PNG")
    return out.getvalue()


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
@pytest.mark.parametrize(
    ("mode", "corners", "expected"),
    [
        (4, [0, 1, 2, 0, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
        (6, None, [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_triangles_strips_and_fans(tmp_path, suffix, mode, corners, expected):
    file = GltfFile()
    file.primitive(corners=corners, mode=mode)
    found, notes = triangles(file.write(tmp_path / f"m.{suffix}"))
    np.testing.assert_array_equal(found, SQUARE[np.array(expected)])
    assert (np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2] > 0).all()
    assert notes == []


def test_sparse_accessors_replace_values_and_stand_alone(tmp_path):
    file = GltfFile()
    row = file.primitive()
    sparse = {
        "count": 1,
        "indices": {"bufferView": file.view(b"\x02"), "componentType": 5121},
        "values": {"bufferView": file.view(np.array([5, 6, 7], "<f4").tobytes())},
    }
    file.tree["accessors"][row["attributes"]["POSITION"]]["sparse"] = sparse
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    assert found[0, 2].tolist() == [5, 6, 7]
    accessor = file.tree["accessors"][row["attributes"]["POSITION"]]
    del accessor["bufferView"]  # then all others are 0
    accessor["sparse"] |= {
        "count": 3,
        "indices": {"bufferView": file.view(b"\0\1\2"), "componentType": 5121},
        "values": {"bufferView": file.view(SQUARE[1:].tobytes())},
    }
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    np.testing.assert_array_equal(found, [SQUARE[[1, 2, 3]], [*SQUARE[[1, 3]], [0, 0, 0]]])


def test_normalized_and_quantized_positions(tmp_path):
    file = GltfFile()
    row = file.primitive()
    for dtype, most, low in (("u2", 65535, 0), ("i1", 127, -128)):
        points = np.array([[low, 0, 0], [most, 0, 0], [most, most, 0], [0, most, 0]])
        row["attributes"]["POSITION"] = file.accessor(points, dtype, normalized=True)
        found, _ = triangles(file.write(tmp_path / "m.glb"))
        assert found.max() == 1.0
        assert found.min() == (-1.0 if low else 0.0)


def test_strides_and_offsets(tmp_path):
    file = GltfFile()
    rows = np.concatenate([np.full((4, 1), 9, "<f4"), SQUARE, np.full((4, 1), 9, "<f4")], axis=1)
    row = file.primitive()
    view = file.view(rows.astype("<f4").tobytes(), byteStride=20)
    place = {"bufferView": view, "byteOffset": 4, "componentType": 5126, "type": "VEC3", "count": 4}
    file.tree["accessors"].append(place)
    row["attributes"]["POSITION"] = len(file.tree["accessors"]) - 1
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    np.testing.assert_array_equal(found[1], SQUARE[[0, 2, 3]])


def test_nodes_move_turn_scale_and_mirror(tmp_path):
    file = GltfFile()
    file.primitive()
    half = np.sqrt(0.5)
    file.tree["nodes"] = [
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 1, 1]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
        {"mesh": 0, "translation": [99, 0, 0]},
    ]
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    turned = np.stack([10 - SQUARE[:, 1], 2 * SQUARE[:, 0], SQUARE[:, 2]], axis=1)
    np.testing.assert_allclose(found[0], turned[[0, 1, 2]], atol=1e-12)
    normal = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    assert (normal[:, 2] > 0).all(), "a mirrored mesh keeps its outside"
    assert len(found) == 4, "a node beside the scene is not shown"
    assert found[2:, :, 2].tolist() == [[5, 5, 5], [5, 5, 5]]


def test_morph_targets_at_rest_and_skins_in_their_pose(tmp_path):
    file = GltfFile()
    row = file.primitive()
    row["targets"] = [{"POSITION": file.accessor(np.tile([[0, 0, 4]], (4, 1)))}]
    file.tree["meshes"][0]["weights"] = [0.5]
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    assert set(found[:, :, 2].ravel()) == {2.0}
    del row["targets"], file.tree["meshes"][0]["weights"]
    row["attributes"]["JOINTS_0"] = file.accessor(np.zeros((4, 4)), "u1")
    row["attributes"]["WEIGHTS_0"] = file.accessor(np.tile([[1, 0, 0, 0]], (4, 1)))
    back = np.eye(4)
    back[3, 0] = -1.0  # in columns
    file.tree["skins"] = [
        {"joints": [1], "inverseBindMatrices": file.accessor(back.reshape(1, 16))}
    ]
    file.tree["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [50, 0, 0]},
        {"translation": [0, 7, 0]},
    ]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    found, _ = triangles(file.write(tmp_path / "m.glb"))
    np.testing.assert_allclose(found[0], SQUARE[[0, 1, 2]] + np.array([-1, 7, 0]))


def test_base_colour_times_vertex_colours(tmp_path):
    file = GltfFile()
    file.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 0.25, 1]}}]
    row = file.primitive(material=0)
    file.primitive(SQUARE + np.array([0, 0, 1]))
    colors = np.array([[255, 0, 255, 255]] * 4)
    row["attributes"]["COLOR_0"] = file.accessor(colors, "u1", normalized=True)
    first, second = load_mesh(file.write(tmp_path / "m.glb")).parts
    np.testing.assert_allclose(first.color, [[0.5, 0, 0.25]] * 2)
    np.testing.assert_allclose(second.color, np.full((2, 3), 0.35))


def textured(file, **sampler):
    """A square with a red texture whose coordinates are those of the square, halved."""
    file.tree["textures"] = [{"source": 0, "sampler": 0}]
    file.tree["samplers"] = [sampler]
    info = {"index": 0}
    file.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": info}}]
    row = file.primitive(material=0)
    row["attributes"]["TEXCOORD_0"] = file.accessor(SQUARE[:, :2] / 2)
    return info


def test_textures_beside_the_file_with_names_that_need_quotes(tmp_path):
    file = GltfFile()
    textured(file)
    (tmp_path / "a b%.png").write_bytes(png((255, 0, 0)))
    file.tree["images"] = [{"uri": "a%20b%25.png"}]
    (part,) = load_mesh(file.write(tmp_path / "m.gltf")).parts
    assert part.image[0, 0].tolist() == [255, 0, 0]
    np.testing.assert_allclose(part.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])  # v up
    np.testing.assert_allclose(part.color, [[1, 0, 0]] * 2)
    (tmp_path / "a b%.png").unlink()
    refused(tmp_path / "m.gltf", "it names 'a b%.png': No such file")
    (tmp_path / "a b%.png").write_bytes(b"no picture")
    refused(tmp_path / "m.gltf", "a texture cannot be read: images[0]")


def test_texture_transform_and_a_second_set_of_coordinates(tmp_path):
    file = GltfFile()
    info = textured(file)
    file.tree["images"] = [{"bufferView": file.view(png((9, 9, 9))), "mimeType": "image/png"}]
    turn = {"offset": [0.5, 0.0], "rotation": np.pi / 2, "scale": [2.0, 1.0], "texCoord": 1}
    info["extensions"] = {"KHR_texture_transform": turn}
    row = file.tree["meshes"][0]["primitives"][0]
    row["attributes"]["TEXCOORD_1"] = file.accessor([[0, 0], [1, 0], [1, 1], [0, 1]])
    (part,) = load_mesh(file.write(tmp_path / "m.glb")).parts
    # u' = 0.5 + v, v' = -2 u in the picture's axes; v points up here
    np.testing.assert_allclose(part.uv, [[0.5, 1], [0.5, 3], [1.5, 3], [1.5, 1]], atol=1e-12)


def test_what_is_left_out_is_noted_once(tmp_path):
    file = GltfFile()
    textured(file, wrapS=33071)
    file.tree["images"] = [{"bufferView": file.view(png((9, 9, 9)))}]
    file.tree["materials"][0] |= {
        "alphaMode": "BLEND",
        "occlusionTexture": {"index": 0},
    }
    primitives = file.tree["meshes"][0]["primitives"]
    primitives += [{**primitives[0], "mode": 1}, primitives[0]]
    primitives[0]["attributes"]["TEXCOORD_0"] = file.accessor(SQUARE[:, :2])
    file.tree["animations"] = [{}]
    file.tree["extensionsUsed"] = ["KHR_lights_punctual"]
    notes = load_mesh(file.write(tmp_path / "m.glb")).notes
    assert notes == [
        "m.glb: extension KHR_lights_punctual ignored",
        "m.glb: animations ignored",
        "m.glb: occlusion map ignored",
        "m.glb: single-sided faces are seen from both sides",
        "m.glb: alpha mode BLEND taken as holes below 0.5",
        "m.glb: lines left out",
    ]


def breaking(file, how):
    """Break a file with one primitive."""
    row = file.primitive()
    tree = file.tree
    if how == "required":
        tree["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    elif how == "old":
        tree["asset"]["version"] = "1.0"
    elif how == "cycle":
        tree["nodes"] = [{"mesh": 0, "children": [0]}]
    elif how == "node":
        tree["scenes"] = [{"nodes": [3]}]
    elif how == "transform":
        tree["nodes"] = [{"mesh": 0, "translation": [1, 2]}]
    elif how == "beyond":
        tree["accessors"][0]["byteOffset"] = 4
    elif how == "huge":
        del tree["accessors"][0]["bufferView"]
        tree["accessors"][0]["count"] = 10**12
    elif how == "type":
        tree["accessors"][0]["componentType"] = 5130
    elif how == "count":
        row["attributes"]["COLOR_0"] = file.accessor(np.ones((3, 3)))
    elif how == "view":
        tree["bufferViews"][0]["byteLength"] = 10**9
    elif how == "corner":
        row["indices"] = file.accessor([0, 1, 7], "u2")


BROKEN = {
    "required": "it requires the extension EXT_mesh_gpu_instancing, which is not supported",
    "old": "glTF version 1.0, readable: 2.x",
    "cycle": "nodes[0] has two parents, or is its own",
    "node": "nodes[3] is named, but there are 1",
    "transform": "nodes[0] has a transform that is none",
    "beyond": "accessors[0] reads beyond its view of 48 bytes",
    "huge": "accessors[0] has 1000000000000 values, at most",
    "type": "accessors[0] is of type 5130 VEC3",
    "count": "COLOR_0 has 3 values for 4 positions",
    "view": "bufferViews[0] ends beyond its buffer",
    "corner": "1 faces name vertices that are not there (it has 4)",
}


@pytest.mark.parametrize("how", BROKEN)
def test_broken_files_are_one_line(tmp_path, how):
    file = GltfFile()
    breaking(file, how)
    refused(file.write(tmp_path / "m.glb"), BROKEN[how])


def test_draco(tmp_path):
    draco = pytest.importorskip("DracoPy", reason="DracoPy is not installed")
    file = GltfFile()
    file.primitive()
    packed = draco.encode(SQUARE, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), quantization_bits=14)
    number = draco.decode(packed).get_attribute_by_type(draco.AttributeType.POSITION)["unique_id"]
    extension = {"bufferView": file.view(packed), "attributes": {"POSITION": number}}
    row = file.primitive(SQUARE + np.array([0, 0, 1]))
    row["extensions"] = {"KHR_draco_mesh_compression": extension}
    file.tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    found, notes = triangles(file.write(tmp_path / "m.glb"))
    assert len(found) == 4, "beside a plain primitive"
    assert notes == []
    for part in (found[:2], found[2:]):
        area = np.linalg.norm(np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]), axis=1)
        assert area.sum() == pytest.approx(8.0, rel=1e-3)
    extension["bufferView"] = file.view(packed[:20])
    refused(file.write(tmp_path / "m.glb"), "its Draco data cannot be read")


def test_without_the_library_of_draco(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    file = GltfFile()
    row = file.primitive()
    row["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
    refused(file.write(tmp_path / "m.glb"), "install drivetwin[gltf], or export without")


def test_a_file_has_so_many_notes_and_no_more(tmp_path):
    file = GltfFile()
    file.primitive()
    file.tree["extensionsUsed"] = [f"EXT_{number}" for number in range(500)]
    notes = load_mesh(file.write(tmp_path / "m.glb")).notes
    assert len(notes) == 62
    assert notes[60] == "m.glb: extension EXT_60 ignored"
    assert notes[-1] == "m.glb: and so on"
