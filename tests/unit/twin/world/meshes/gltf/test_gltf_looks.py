"""Materials of glTF files: holes, normals, colours, maps and light as the standard has them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from unit.twin.world.meshes.gltf.gltf_files import SQUARE, GltfFile

from twin.world.meshes.details import CLAMP, EMISSION, MIRRORED, NORMAL, REPEAT, SHINE
from twin.world.meshes.mesh_file import load_mesh

_TWO_SIDED = {"doubleSided": True}
_UP = [[0, 0, 1]] * 4


def png(values):
    out = io.BytesIO()
    Image.fromarray(np.asarray(values, np.uint8)).save(out, "PNG")
    return out.getvalue()


def alpha_picture(alpha):
    """Grey RGBA with this alpha [h, w]."""
    alpha = np.asarray(alpha)
    return np.dstack([np.full((*alpha.shape, 3), 90), alpha])


class Painted:
    """A square with a material and as many pictures as are added."""

    def __init__(self, surface=None, **more):
        self.file = GltfFile()
        tree = self.file.tree
        tree |= {"images": [], "textures": [], "samplers": []}
        self.surface = dict(surface or {})
        self.material = {"pbrMetallicRoughness": self.surface, **_TWO_SIDED, **more}
        tree["materials"] = [self.material]
        self.row = self.file.primitive(material=0)
        self.attribute("TEXCOORD_0", SQUARE[:, :2] / 2)

    def attribute(self, name, values, *args, **more):
        self.row["attributes"][name] = self.file.accessor(values, *args, **more)

    def texture(self, values, wraps=(10497, 10497), **info):
        tree = self.file.tree
        number = len(tree["textures"])
        tree["images"].append({"bufferView": self.file.view(png(values))})
        tree["samplers"].append({"wrapS": wraps[0], "wrapT": wraps[1]})
        tree["textures"].append({"source": number, "sampler": number})
        return {"index": number, **info}

    def read(self, tmp_path):
        data = load_mesh(self.file.write(tmp_path / "m.glb"))
        return data.parts, data.notes


def test_alpha_is_a_mask_with_the_factor_in_its_limit(tmp_path):
    made = Painted({"baseColorFactor": [1, 1, 1, 0.8]}, alphaMode="MASK", alphaCutoff=0.4)
    made.surface["baseColorTexture"] = made.texture(alpha_picture([[0, 255], [100, 200]]))
    (part,), notes = made.read(tmp_path)
    assert part.alpha.tolist() == [[0, 255], [100, 200]]
    assert part.cutoff == pytest.approx(255 * 0.4 / 0.8)
    assert part.image.shape == (2, 2, 3)
    assert notes == []


@pytest.mark.parametrize(("mode", "alpha"), [("OPAQUE", 0), ("MASK", 255), ("MASK", 128)])
def test_what_has_no_holes_has_no_mask(tmp_path, mode, alpha):
    made = Painted(alphaMode=mode)
    made.surface["baseColorTexture"] = made.texture(alpha_picture([[alpha, 255]]))
    (part,), notes = made.read(tmp_path)
    assert part.alpha is None
    assert notes == []


def test_blended_pictures_have_holes_below_a_half(tmp_path):
    made = Painted(alphaMode="BLEND", alphaCutoff=0.1)
    made.surface["baseColorTexture"] = made.texture(alpha_picture([[0, 255]]))
    (part,), notes = made.read(tmp_path)
    assert part.cutoff == 127.5
    assert notes == ["m.glb: alpha mode BLEND taken as holes below 0.5"]


def test_what_is_transparent_throughout_is_left_out(tmp_path):
    made = Painted({"baseColorFactor": [1, 1, 1, 0.3]}, alphaMode="BLEND")
    made.file.primitive(SQUARE + np.array([0, 0, 1]))
    parts, notes = made.read(tmp_path)
    assert [part.points[0, 2] for part in parts] == [1.0]
    assert notes[-1] == "m.glb: parts that are transparent throughout left out"


def test_wrap_modes_of_each_axis(tmp_path):
    made = Painted()
    made.surface["baseColorTexture"] = made.texture([[(9, 9, 9)]], (33071, 33648))
    (part,), notes = made.read(tmp_path)
    assert part.wrap == [CLAMP, MIRRORED]
    made = Painted()
    made.surface["baseColorTexture"] = made.texture([[(9, 9, 9)]], (10497, 1))
    (part,), other = made.read(tmp_path)
    assert part.wrap == [REPEAT, REPEAT]
    assert (notes, other) == (
        [],
        ["m.glb: a sampler with an unknown wrap mode: its textures repeat"],
    )


def test_normals_turn_with_their_surface_whatever_the_scale(tmp_path):
    """Of a plane z = x / 2 that is squeezed, mirrored and turned; the normal stays at right angles
    to it, and on its front."""
    points = SQUARE * np.array([1, 1, 0]) + SQUARE[:, :1] * np.array([0, 0, 0.5])
    slanted = np.array([-0.5, 0.0, 1.0]) / np.sqrt(1.25) + np.array([0.0, 0.3, 0.0])
    for scale in ((1, 1, 1), (3, 0.5, 2), (-3, 0.5, 2), (-1, -1, -1)):
        file = GltfFile()
        row = file.primitive(points)
        plane = [[-0.5, 0, 1]] * 3 + [slanted.tolist()]
        row["attributes"]["NORMAL"] = file.accessor(plane)
        turn = [0.2, 0.4, 0.1, 0.8832]
        file.tree["nodes"] = [
            {"mesh": 0, "scale": scale, "rotation": turn, "translation": [5, 6, 7]}
        ]
        (part,) = load_mesh(file.write(tmp_path / "m.glb")).parts
        corners = part.points[part.faces[0]]
        front = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        front /= np.linalg.norm(front)
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0)
        np.testing.assert_allclose(part.normals[:3] @ front, 1.0, atol=1e-6)


def test_normals_that_are_those_of_the_faces_are_not_kept(tmp_path):
    made = Painted()
    made.attribute("NORMAL", _UP)
    (part,), _ = made.read(tmp_path)
    assert part.normals is None


def test_morph_targets_move_normals(tmp_path):
    made = Painted()
    made.attribute("NORMAL", _UP)
    target = {"NORMAL": made.file.accessor([[1, 0, 0]] * 4)}
    made.row["targets"] = [target]
    made.file.tree["meshes"][0]["weights"] = [0.5]
    (part,), _ = made.read(tmp_path)
    np.testing.assert_allclose(part.normals, [np.array([0.5, 0, 1]) / np.sqrt(1.25)] * 4)


def test_vertex_colours_between_corners_and_under_a_texture(tmp_path):
    colors = [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 1, 1]]
    bare = Painted({"baseColorFactor": [0.5, 1, 0.25, 1]})
    bare.attribute("COLOR_0", colors)
    (part,), notes = bare.read(tmp_path)
    np.testing.assert_allclose(part.colors, np.array(colors)[:, :3] * (0.5, 1, 0.25))
    np.testing.assert_allclose(part.color, part.colors[part.faces].mean(axis=1))
    assert notes == []
    under = Painted({"baseColorFactor": [0.5, 1, 0.25, 1]})
    under.surface["baseColorTexture"] = under.texture([[(255, 255, 255)]])
    under.attribute("COLOR_0", colors)
    (part,), notes = under.read(tmp_path)
    np.testing.assert_allclose(part.colors, np.array(colors)[:, :3])  # the image has the factor
    assert part.image[0, 0].tolist() == [188, 255, 137]  # sRGB of 0.5, 1, 0.25
    assert notes == []


def test_alpha_of_vertex_colours_is_noted_where_alpha_counts(tmp_path):
    made = Painted(alphaMode="MASK")
    made.attribute("COLOR_0", [[1, 0, 0, 0.2]] * 4)
    _, notes = made.read(tmp_path)
    assert notes == ["m.glb: alpha of vertex colours ignored"]


def test_own_light_with_its_strength(tmp_path):
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 5}}
    made = Painted(emissiveFactor=[1, 0.5, 0], extensions=strength)
    made.file.tree["extensionsUsed"] = list(strength)
    made.material["emissiveTexture"] = made.texture([[(1, 2, 3)]], (33071, 10497))
    (part,), notes = made.read(tmp_path)
    assert part.emission == [5.0, 2.5, 0.0]
    assert part.maps[EMISSION].tolist() == [[[1, 2, 3]]]
    assert part.map_wraps[EMISSION] == [CLAMP, REPEAT]
    assert notes == []


def test_an_emissive_picture_without_a_factor_is_dark(tmp_path):
    made = Painted()
    made.material["emissiveTexture"] = made.texture([[(255, 255, 255)]])
    (part,), _ = made.read(tmp_path)
    assert part.maps == [None, None, None]
    assert part.emission == [0.0, 0.0, 0.0]


def test_maps_and_their_coordinates(tmp_path):
    """A map with a transform of its own finds its texels from the coordinates of the first."""
    made = Painted({"metallicFactor": 0.5, "roughnessFactor": 0.25})
    first = {"KHR_texture_transform": {"scale": [2, 3], "offset": [0.1, 0.2]}}
    own = {"scale": [0.5, 4], "rotation": 0.7, "offset": [-1, 3]}
    made.surface["baseColorTexture"] = made.texture([[(1, 1, 1)]], extensions=first)
    info = made.texture([[(128, 128, 255)]], extensions={"KHR_texture_transform": own})
    made.material["normalTexture"] = {**info, "scale": 0.6}
    made.surface["metallicRoughnessTexture"] = made.texture([[(0, 80, 160)]], extensions=first)
    (part,), notes = made.read(tmp_path)
    assert (part.metallic, part.roughness, part.normal_scale) == (0.5, 0.25, 0.6)
    assert part.maps[SHINE].tolist() == [[[0, 80, 160]]]
    np.testing.assert_allclose(part.map_from_uv[SHINE], np.eye(2, 3))
    raw = SQUARE[:, :2] / 2
    c, s = np.cos(0.7), np.sin(0.7)
    u = c * 0.5 * raw[:, 0] + s * 4 * raw[:, 1] - 1
    v = -s * 0.5 * raw[:, 0] + c * 4 * raw[:, 1] + 3
    found = np.column_stack([part.uv, np.ones(4)]) @ part.map_from_uv[NORMAL].T
    np.testing.assert_allclose(found, np.column_stack([u, 1 - v]), atol=1e-6)
    assert notes == []


def test_a_map_with_other_coordinates_is_noted(tmp_path):
    made = Painted()
    made.surface["baseColorTexture"] = made.texture([[(1, 1, 1)]])
    made.material["normalTexture"] = made.texture([[(128, 128, 255)]], texCoord=1)
    (part,), notes = made.read(tmp_path)
    assert part.maps[NORMAL] is None
    assert notes == ["m.glb: a map with other coordinates than the material's first ignored"]


def test_tangents_of_a_mirrored_mesh_turn_over(tmp_path):
    made = Painted()
    made.material["normalTexture"] = made.texture([[(128, 128, 255)]])
    made.attribute("NORMAL", _UP)
    made.attribute("TANGENT", [[1, 0, 0, 1]] * 4)
    made.file.tree["nodes"] = [{"mesh": 0, "scale": [2, -1, 1]}]
    (part,), _ = made.read(tmp_path)
    np.testing.assert_allclose(part.tangents, [[2, 0, 0, -1]] * 4)


def test_single_sided_materials_are_noted_once(tmp_path):
    made = Painted()
    del made.material["doubleSided"]
    made.file.primitive(SQUARE + np.array([0, 0, 1]), material=0)
    _, notes = made.read(tmp_path)
    assert notes == ["m.glb: single-sided faces are seen from both sides"]


def test_broken_numbers_of_a_look_are_noted_not_shown(tmp_path):
    made = Painted()
    made.surface["baseColorTexture"] = made.texture([[(1, 1, 1)]])
    made.attribute("TEXCOORD_0", [[0, 0], [np.nan, 0], [1, 1], [0, 1]])
    made.attribute("NORMAL", [[0, 0, np.inf]] * 4)
    (part,), notes = made.read(tmp_path)
    assert (part.uv, part.image, part.normals) == (None, None, None)
    assert notes == ["m.glb: normals, texture coordinates that are NaN or infinite ignored"]


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("alphaCutoff", "half", "'alphaCutoff' is half, needed 1 numbers"),
        ("emissiveFactor", [1, 2], "'emissiveFactor' is [1, 2], needed 3 numbers"),
        ("emissiveFactor", [1, -2, 0], "a material emits less than nothing"),
        ("normalTexture", {"index": 7}, "textures[7] is named, but there are 0"),
    ],
)
def test_broken_looks_are_one_line(tmp_path, key, value, expected):
    made = Painted(alphaMode="MASK", **{key: value})
    with pytest.raises(ValueError) as error:
        made.read(tmp_path)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)
