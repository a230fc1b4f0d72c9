"""Details of faces: rows, tangents, and which materials need any."""

import numpy as np
import pytest

from twin.world.meshes.details import (
    CLAMP,
    MIRRORED,
    REPEAT,
    SHINE,
    CornerDetails,
    FaceLook,
    sharp_share,
    tangents_of,
    texture_kind,
    wrapped,
)
from twin.world.meshes.mesh import MeshBuilder
from twin.world.meshes.part import Part
from twin.world.meshes.world_looks import WorldLooks

TRIANGLE = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
FACE = np.array([[0, 1, 2]])
GREY = (0.4, 0.4, 0.4)


def test_only_faces_with_details_take_rows():
    mesh = MeshBuilder()
    mesh.add(TRIANGLE, FACE, 0, GREY)
    slanted = np.array([[0.6, 0, 0.8], [0, 0, 1], [0, 0, 1]])
    mesh.add(TRIANGLE, FACE, 0, GREY, details=CornerDetails(3, normals=slanted))
    mesh.add(TRIANGLE, FACE, 0, GREY)
    mesh.add(TRIANGLE, FACE, 0, GREY, details=CornerDetails(1, colors=np.eye(3)))
    details = mesh.build().details
    assert details.row.tolist() == [-1, 0, -1, 1]
    assert details.look.tolist() == [3, 1]
    np.testing.assert_allclose(details.normal[0], slanted, rtol=1e-6)
    assert not details.normal[1].any()
    np.testing.assert_array_equal(details.color[1], np.eye(3))
    assert details.tangent.shape == (0, 3, 4)


def test_a_mesh_without_details_has_none():
    mesh = MeshBuilder()
    mesh.add(TRIANGLE, FACE, 0, GREY)
    assert mesh.build().details is None


def test_normals_that_point_into_their_face_are_turned_over():
    mesh = MeshBuilder()
    inward = np.array([[0.6, 0, -0.8], [0, 0, -1], [0, 0.6, -0.8]])
    mesh.add(TRIANGLE, FACE, 0, GREY, details=CornerDetails(0, normals=inward))
    np.testing.assert_allclose(mesh.build().details.normal[0], -inward, rtol=1e-6)


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_tangents_point_along_growing_u(flip):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.normal(size=(20, 2)), np.zeros(20)])
    faces = rng.permutation(20)[:18].reshape(-1, 3)
    uv = points[:, :2] @ np.array([[0.6, -0.8 * flip], [0.8, 0.6 * flip]]) * 3.0 + 0.2
    found = tangents_of(points, faces, uv, np.tile([0.0, 0, 1], (20, 1)))[np.unique(faces)]
    np.testing.assert_allclose(found, [[0.6, 0.8, 0.0, flip]] * 18, atol=1e-9)
    # v grows along 1 or -1 times normal x tangent
    along_v = np.cross([0, 0, 1.0], found[0, :3]) * found[0, 3]
    step = along_v[:2] @ np.array([[0.6, -0.8 * flip], [0.8, 0.6 * flip]])
    np.testing.assert_allclose(step, [0.0, 1.0], atol=1e-9)


def test_coordinates_without_area_have_no_tangent():
    found = tangents_of(TRIANGLE, FACE, np.zeros((3, 2)), np.tile([0.0, 0, 1], (3, 1)))
    assert not found.any()


def test_coordinates_beyond_the_borders():
    values = np.array([-1.25, -0.25, 0.25, 1.25, 2.25])
    np.testing.assert_allclose(wrapped(values, REPEAT), [0.75, 0.75, 0.25, 0.25, 0.25])
    np.testing.assert_allclose(wrapped(values, CLAMP), [0, 0, 0.25, 1, 1])
    np.testing.assert_allclose(wrapped(values, MIRRORED), [0.75, 0.25, 0.25, 0.75, 0.25])


def test_sharpness_falls_with_roughness():
    assert sharp_share(0.0) == sharp_share(0.1) == 1.0
    assert sharp_share(0.6) == sharp_share(1.0) == 0.0
    assert sharp_share(0.35) == pytest.approx(0.25)


def part(**values):
    return Part(TRIANGLE, FACE, np.full((1, 3), 0.5), **values)


def details_of(looks, found, own_look=True):
    return looks.details(found, np.eye(3), own_look=own_look, emission_cd_m2=100.0)


def test_a_plain_part_needs_no_details():
    looks = WorldLooks()
    image = np.zeros((2, 2, 3), np.uint8)
    assert details_of(looks, part(uv=TRIANGLE[:, :2], image=image, metallic=1.0)) is None
    assert details_of(looks, part(roughness=0.7)) is None
    assert looks.looks == []


def test_parts_that_look_alike_share_a_look():
    looks = WorldLooks()
    numbers = [
        details_of(looks, part(emission=[1.0, 0.0, 2.0])).look,
        details_of(looks, part(roughness=0.2, metallic=1.0)).look,
        details_of(looks, part(emission=[1.0, 0.0, 2.0])).look,
    ]
    assert numbers == [0, 1, 0]
    assert looks.looks[0].emission == (100.0, 0.0, 200.0)
    assert looks.looks[1].mirrors


def test_rough_and_dull_surfaces_are_worth_no_ray():
    looks = WorldLooks()
    shine = np.zeros((1, 1, 3), np.uint8)
    shine[...] = (0, 200, 255)
    maps = [None, None, shine]
    details_of(looks, part(uv=TRIANGLE[:, :2], metallic=1.0, maps=maps))
    assert looks.looks[0].maps[SHINE] == 0
    assert not looks.looks[0].mirrors
    details_of(looks, part(roughness=0.5))
    assert not looks.looks[1].mirrors  # 4 % of 4 %


def test_an_image_is_there_once_for_each_way_it_goes_on():
    looks = WorldLooks()
    image = np.zeros((2, 2, 3), np.uint8)
    numbers = [
        looks.image(image, [REPEAT, REPEAT]),
        looks.image(image, [CLAMP, REPEAT]),
        looks.image(image, [REPEAT, REPEAT]),
        looks.image(image, [REPEAT, REPEAT], data=True),
        looks.image(None, [REPEAT, REPEAT]),
    ]
    assert numbers == [0, 1, 0, 2, -1]
    assert looks.kinds == [0, texture_kind(CLAMP, REPEAT), texture_kind(0, 0, data=True)]
    assert all(found is image for found in looks.textures)


def test_with_a_look_of_the_scene_only_the_shape_stays():
    looks = WorldLooks()
    normals = np.array([[0.6, 0, 0.8], [0, 0, 1], [0, 0, 1]])
    found = part(
        uv=TRIANGLE[:, :2],
        normals=normals,
        colors=np.eye(3),
        emission=[1.0, 1.0, 1.0],
        roughness=0.0,
        alpha=np.zeros((1, 1), np.uint8),
        cutoff=10.0,
    )
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    details = looks.details(found, turn, own_look=False, emission_cd_m2=1.0)
    assert looks.looks == [FaceLook(mask=0, smooth=True)]
    assert details.colors is None
    np.testing.assert_allclose(details.normals[0], [0, 0.6, 0.8])
    assert looks.masks[0].cutoff == 10.0
