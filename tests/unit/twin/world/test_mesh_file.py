"""Meshes from files: what comes in, and one clear line for what cannot."""

import json
import struct
import warnings

import numpy as np
import pytest
import trimesh
from PIL import Image

from schemas.files.assets import mesh_files
from twin.world.meshes import mesh_file, mesh_header
from twin.world.meshes.mesh_file import load_mesh
from twin.world.meshes.mesh_header import FACES_MAX
from twin.world.meshes.srgb import linear, srgb

TRIANGLE = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
OBJ = "v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n"


def refused(path, expected):
    with pytest.raises(ValueError) as error:
        load_mesh(path)
    text = str(error.value)
    assert expected in text, text
    assert path.name in text
    assert "\n" not in text


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb", "gltf"])
def test_every_format_brings_its_points_and_faces(tmp_path, suffix):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    path = tmp_path / f"box.{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if suffix == "gltf":
            for name, data in trimesh.Scene(box).export(file_type="gltf").items():
                (tmp_path / name.replace("model", "box")).write_bytes(data)
        else:
            box.export(path)
    data = load_mesh(path)
    assert sum(len(part.faces) for part in data.parts) == 12
    points = np.concatenate([part.points[part.faces].reshape(-1, 3) for part in data.parts])
    np.testing.assert_allclose(points.max(axis=0), [0.5, 1.0, 1.5])
    assert data.notes == []


def test_vertex_colours_of_a_scan_become_face_colours(tmp_path):
    colors = np.array([[255, 0, 0, 255], [255, 0, 0, 255], [0, 0, 255, 255]], np.uint8)
    path = tmp_path / "scan.ply"
    trimesh.Trimesh(TRIANGLE, [[0, 1, 2]], vertex_colors=colors, process=False).export(path)
    (part,) = load_mesh(path).parts
    np.testing.assert_allclose(part.color, [[2 / 3, 0, 1 / 3]], atol=1e-6)
    grey = linear(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(grey, [0, 0.21404, 1], atol=1e-5)
    np.testing.assert_allclose(srgb(grey), [0, 0.5, 1], atol=1e-12)


def test_textures_come_with_coordinates_and_are_made_smaller(tmp_path):
    Image.new("RGB", (4096, 1024), (200, 100, 50)).save(tmp_path / "wall.png")
    write(tmp_path, "wall.mtl", "newmtl wall\nmap_Kd wall.png\n")
    text = "mtllib wall.mtl\nv 0 0 0\nv 2 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    path = write(tmp_path, "wall.obj", text + "usemtl wall\nf 1/1 2/2 3/3\n")
    data = load_mesh(path)
    (part,) = data.parts
    assert part.image.shape == (512, 2048, 3)
    assert part.image[0, 0].tolist() == [200, 100, 50]
    np.testing.assert_allclose(part.uv[part.faces[0]], [[0, 0], [1, 0], [0, 1]])
    assert data.notes == ["wall.obj: a texture of 4096 x 1024 px scaled to 2048 x 512"]
    (tmp_path / "wall.png").write_bytes(b"broken")
    data = load_mesh(path)  # a picture that is none: the mesh comes without it
    assert data.parts[0].image is None


def test_files_that_are_no_meshes(tmp_path):
    refused(tmp_path / "missing.glb", "No such file")
    refused(write(tmp_path, "notes.txt", "hello"), "allowed: .glb, .gltf, .obj, .ply, .stl")
    refused(write(tmp_path, "empty.obj", b""), "the file is empty")
    refused(write(tmp_path, "noise.glb", b"\x07" * 500), "no GLB header")
    refused(write(tmp_path, "noise.ply", b"\x07" * 500), "no PLY header")
    refused(write(tmp_path, "noise.stl", b"\x07" * 500), f"faces, at most {FACES_MAX}")
    refused(write(tmp_path, "list.gltf", "[1, 2]"), "no glTF document")
    refused(write(tmp_path, "noise.obj", b"\x07\xff" * 500), "the mesh has no faces")
    refused(write(tmp_path, "odd.obj", b"v 0 0 0\nf 1 x \xff\n"), "cannot be read as a mesh")
    (tmp_path / "folder.obj").mkdir()
    refused(tmp_path / "folder.obj", "a folder")


def test_bad_numbers_and_indices(tmp_path):
    refused(write(tmp_path, "nan.obj", OBJ.replace("2 0 0", "nan 0 0")), "1 vertices are NaN")
    refused(write(tmp_path, "inf.obj", OBJ.replace("2 0 0", "inf 0 0")), "NaN or infinite")
    refused(write(tmp_path, "points.obj", "v 0 0 0\nv 1 0 0\n"), "the mesh has no faces")
    ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    ply += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in TRIANGLE)
    refused(write(tmp_path, "far.ply", ply + points + "3 0 1 7\n"), "1 faces name vertices")
    assert len(load_mesh(write(tmp_path, "ok.ply", ply + points + "3 0 1 2\n")).parts) == 1


def test_an_index_out_of_range_is_named(tmp_path):
    path = tmp_path / "far.glb"
    path.write_bytes(_glb([0, 1, 9]))
    refused(path, "1 faces name vertices that are not there (it has 3)")
    path.write_bytes(_glb([0, 1, 2])[:-20])
    refused(path, "cannot be read as a mesh")
    path.write_bytes(_glb([0, 1, 2]))
    assert len(load_mesh(path).parts[0].faces) == 1


def _glb(indices):
    """One triangle as GLB, with these indices."""
    data = np.array(TRIANGLE, "<f4").tobytes() + np.array(indices, "<u4").tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 48}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    return head + chunks + struct.pack("<I4s", len(data), b"BIN\0") + data


def test_faces_without_area_are_left_out_with_a_note(tmp_path):
    flat = "v 4 0 0\nf 1 2 4\nf 1 1 2\n"
    data = load_mesh(write(tmp_path, "flat.obj", OBJ + flat))
    assert sum(len(part.faces) for part in data.parts) == 1
    assert data.notes == ["flat.obj: 2 faces without area left out"]
    only = "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"
    refused(write(tmp_path, "only.obj", only), "no faces left: all 1 have no area")


def test_a_hundred_million_faces_are_refused_by_the_header(tmp_path):
    """None of these files holds what it declares: reading on would fail otherwise."""
    many = 100_000_000
    stl = write(tmp_path, "many.stl", bytes(80) + struct.pack("<I", many) + bytes(50))
    refused(stl, f"{many} faces, at most {FACES_MAX}")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 9\nelement face {many}\n"
    refused(write(tmp_path, "many.ply", head + "end_header\n"), f"{many} faces")
    tree = {
        "nodes": [{"mesh": 0}, {"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"count": 3 * many // 2}],
    }
    refused(write(tmp_path, "many.gltf", json.dumps(tree)), f"{many} faces")
    text = json.dumps(tree).encode()
    glb = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text
    refused(write(tmp_path, "many.glb", glb), f"{many} faces")


def test_formats_without_a_count_are_judged_by_their_size(tmp_path, monkeypatch):
    path = tmp_path / "huge.obj"
    with path.open("wb") as file:
        file.truncate(mesh_header.FILE_BYTES_MAX + 1)  # sparse: takes no room
    refused(path, f"{mesh_header.FILE_BYTES_MAX + 1} bytes, at most")
    monkeypatch.setattr(mesh_file, "FACES_MAX", 1)
    two = OBJ + "v 5 5 5\nf 2 3 4\n"
    refused(write(tmp_path, "two.obj", two), "more than 1 faces")


def _wall(folder, line, encoding="utf-8", library="a.mtl"):
    (folder / library).parent.mkdir(exist_ok=True)
    text = f"# gr\xf6\xdfer\nnewmtl Geb\xe4ude\nKd 0.5 0.5 0.5\n{line}\n"
    (folder / library).write_bytes(text.encode(encoding))
    text = f"# gr\xf6\xdfer\nmtllib {library}\nv 0 0 0\nv 2 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    text += "usemtl Geb\xe4ude\nf 1/1 2/2 3/3\n"
    return write(folder, "wall.obj", text.encode(encoding))


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize(
    ("line", "picture"),
    [
        ("map_Kd wall.png", "wall.png"),
        ("map_Kd .\\wall.png", "wall.png"),
        ("map_Kd -s 1 1 1 -clamp on p\\my wall.png", "p/my wall.png"),
        ("map_Kd C:\\me\\wall.png", "wall.png"),
        ("map_Kd ../beside/wall.png", "../beside/wall.png"),
        ("map_Kd w\xfc.png", "w\xfc.png"),
    ],
)
def test_a_picture_is_found_however_it_is_named(tmp_path, line, picture, encoding):
    folder = tmp_path / "m"
    place = folder / picture
    folder.mkdir()
    place.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (4, 4), (200, 100, 50)).save(place)
    path = _wall(folder, line, encoding)
    (part,) = load_mesh(path).parts
    assert part.image is not None
    assert part.image[0, 0].tolist() == [200, 100, 50]
    assert place.resolve() in [named.resolve() for named in mesh_files(path)]


def test_what_is_named_and_not_there_is_a_note(tmp_path):
    data = load_mesh(_wall(tmp_path, "map_Kd gone.png"))
    assert data.notes == ["wall.obj: it names gone.png, which is not there; ignored"]
    assert data.parts[0].image is None
    (tmp_path / "a.mtl").unlink()
    data = load_mesh(tmp_path / "wall.obj")
    assert data.notes == ["wall.obj: it names a.mtl, which is not there; ignored"]


def test_a_picture_beside_its_library(tmp_path):
    (tmp_path / "lib").mkdir()
    Image.new("RGB", (4, 4), (200, 100, 50)).save(tmp_path / "lib" / "wall.png")
    (part,) = load_mesh(_wall(tmp_path, "map_Kd wall.png", library="lib/a.mtl")).parts
    assert part.image is not None


def test_comments_in_another_encoding(tmp_path):
    note = "gr\xf6\xdfer".encode("latin-1")
    ply = b"ply\nformat ascii 1.0\ncomment " + note + b"\nelement vertex 3\nproperty float x\n"
    ply += b"property float y\nproperty float z\nelement face 1\n"
    ply += b"property list uchar int vertex_indices\nend_header\n"
    ply += "".join(f"{x} {y} {z}\n" for x, y, z in TRIANGLE).encode() + b"3 0 1 2\n"
    text = b"solid " + note + b"\nfacet normal 0 0 1\nouter loop\n"
    text += "".join(f"vertex {x} {y} {z}\n" for x, y, z in TRIANGLE).encode()
    text += b"endloop\nendfacet\nendsolid " + note + b"\n"
    corners = np.array([[0, 0, 1], *TRIANGLE], "<f4").tobytes()
    stl = note.ljust(80, b"\0") + struct.pack("<I", 1) + corners + bytes(2)
    obj = b"# " + note + b"\n" + OBJ.encode()
    for name, data in {"a.ply": ply, "t.stl": text, "b.stl": stl, "a.obj": obj}.items():
        (part,) = load_mesh(write(tmp_path, name, data)).parts
        np.testing.assert_allclose(part.points[part.faces[0]], TRIANGLE, err_msg=name)
