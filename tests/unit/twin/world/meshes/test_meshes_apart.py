"""twin.world.meshes.apart: what a process apart reads is what is read here, to the last bit."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from twin.world.apart import reading
from twin.world.meshes.apart import MESH_DATA, PART, read_files, read_mesh
from twin.world.meshes.mesh_file import load_mesh
from twin.world.scene import Scene, load_scene

WALL = "mtllib wall.mtl\nv 0 0 0\nv 2 0 0\nv 0 3 0\nv 2 3 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
WALL += "usemtl wall\nf 1/1 2/2 3/3\nusemtl more\nf 2/1 4/2 3/3\n"


def same(a: object, b: object) -> None:
    """Equal in type and to the last bit, field by field."""
    assert type(a) is type(b)
    if dataclasses.is_dataclass(a):
        for each in dataclasses.fields(a):
            same(getattr(a, each.name), getattr(b, each.name))
    elif isinstance(a, list | tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        assert np.ascontiguousarray(a).tobytes() == b.tobytes()
    else:
        assert a == b


def wall(folder: Path) -> Path:
    """A mesh with two materials and a picture in a folder below it."""
    pictures = folder / "m" / "pictures"
    pictures.mkdir(parents=True)
    Image.radial_gradient("L").convert("RGB").resize((2100, 40)).save(pictures / "wall.png")
    text = "newmtl wall\nmap_Kd pictures/wall.png\nnewmtl more\nKd 0.1 0.2 0.3\n"
    (folder / "m" / "wall.mtl").write_text(text)
    path = folder / "m" / "wall.obj"
    path.write_text(WALL)
    return path


def box(folder: Path, suffix: str) -> Path:
    """A box with colours of its vertices."""
    mesh = trimesh.creation.box((1.0, 2.0, 3.0))
    mesh.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4) * 7
    path = folder / f"box.{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if suffix == "gltf":
            for name, data in trimesh.Scene(mesh).export(file_type="gltf").items():
                (folder / name.replace("model", "box")).write_bytes(data)
        else:
            mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb", "gltf"])
def test_every_format_is_the_same_apart(tmp_path: Path, suffix: str) -> None:
    path = box(tmp_path, suffix)
    same(load_mesh(path), read_mesh(path))


def test_pictures_come_along(tmp_path: Path) -> None:
    path = wall(tmp_path)
    found = read_mesh(path)
    same(load_mesh(path), found)
    pictures = [part.image for part in found.parts if part.image is not None]
    assert [picture.shape for picture in pictures] == [(39, 2048, 3)]
    assert found.notes == ["wall.obj: a texture of 2100 x 40 px scaled to 2048 x 39"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("gone.obj", None),
        ("folder.obj", ""),
        ("pipe.ply", None),
        ("notes.txt", "hello"),
        ("empty.stl", ""),
        ("noise.glb", "\x07" * 500),
        ("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 3 0\nf 1 2 3\n"),
        ("lines.gltf", json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin"}]})),
        ("version.gltf", json.dumps({"asset": {"version": "1.0\n"}})),
        ("noise.obj", "\x07\x08" * 500),
    ],
)
@pytest.mark.parametrize("relative", [False, True])
def test_a_refusal_is_the_same_line_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str | None, relative: bool
) -> None:
    path = tmp_path / "below" / name
    path.parent.mkdir()
    if name == "folder.obj":
        path.mkdir()
    elif name == "pipe.ply":
        os.mkfifo(path)
    elif content is not None:
        path.write_text(content)
    if relative:
        monkeypatch.chdir(tmp_path)
        path = Path("below") / name
    lines = []
    for load in (load_mesh, read_mesh):
        with pytest.raises(ValueError) as caught:
            load(path)
        lines.append(str(caught.value))
    assert lines[1] == " ".join(lines[0].splitlines())
    assert str(path) in lines[1]


def test_files_behind_links_and_dots_are_found(tmp_path: Path) -> None:
    path = wall(tmp_path)
    (tmp_path / "link").symlink_to(tmp_path / "m")
    (tmp_path / "beside").mkdir()
    (tmp_path / "alias.obj").symlink_to(box(tmp_path, "obj"))
    for odd in (tmp_path / "link" / path.name, tmp_path / "beside" / ".." / "m" / path.name):
        same(load_mesh(odd), read_mesh(odd))
    same(load_mesh(tmp_path / "alias.obj"), read_mesh(tmp_path / "alias.obj"))


def test_python_may_have_been_called_by_a_path_with_dots(tmp_path: Path) -> None:
    here = Path(__file__).parent
    python = os.path.relpath(sys.executable, here)
    code = "import sys; from pathlib import Path; from twin.world.meshes.apart import read_mesh; "
    code += "print(len(read_mesh(Path(sys.argv[1])).parts))"
    command = [python, "-c", code, str(box(tmp_path, "ply"))]
    done = subprocess.run(command, cwd=here, capture_output=True, text=True, check=False)
    assert done.stdout == "1\n", done.stderr


def scene(folder: Path, **keys: object) -> Scene:
    """A scene file, loaded."""
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"schema": 1, "scene": "s", **keys}))
    return load_scene(str(path))


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Processes of parsers that were started."""
    found: list[int] = []
    popen: Callable[..., object] = reading._popen

    def counted(*words: object) -> object:
        child = popen(*words)
        found.append(child.pid)
        return child

    monkeypatch.setattr(reading, "_popen", counted)
    return found


def test_one_process_reads_all_files_of_a_scene(tmp_path: Path, started: list[int]) -> None:
    np.save(tmp_path / "hill.npy", np.arange(12.0).reshape(3, 4))
    files = [{"file": "m/wall.obj"}, {"file": "box.ply"}, {"file": "m/wall.obj", "scale": 2}]
    wall(tmp_path), box(tmp_path, "ply")
    terrain = {"heightmap": "hill.npy", "size_m": [9, 9]}
    found = read_files(scene(tmp_path, meshes=files, terrain=terrain))
    assert len(started) == 1
    assert found.samples is not None
    assert found.samples.tolist() == np.arange(12.0).reshape(3, 4).tolist()
    assert found.meshes[0] is found.meshes[2]
    same(load_mesh(tmp_path / "box.ply"), found.meshes[1])
    assert found.notes == ((reading.unprotected(),) if reading.unprotected() else ())


def test_a_scene_without_files_starts_nothing(tmp_path: Path, started: list[int]) -> None:
    assert read_files(scene(tmp_path)).meshes == ()
    assert started == []


def test_the_place_in_the_scene_file_is_told(tmp_path: Path, started: list[int]) -> None:
    box(tmp_path, "ply")
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\n")
    files = [{"file": "box.ply"}, {"file": "bad.obj"}]
    with pytest.raises(ValueError, match=r"^meshes\[1\]: .*bad\.obj: the mesh has no faces$"):
        read_files(scene(tmp_path, meshes=files))
    # What needs no parser is refused before one is started.
    files[0] = {"file": "gone.ply"}
    with pytest.raises(ValueError, match=r"^meshes\[0\]: .*gone\.ply: No such file"):
        read_files(scene(tmp_path, meshes=files))
    assert len(started) == 1


def test_without_a_sandbox_it_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "why_not", lambda: "none here")
    path = box(tmp_path, "ply")
    found = read_files(scene(tmp_path, meshes=[{"file": "box.ply"}] * 2))
    assert found.notes == ("meshes and heightmaps are read without a sandbox: none here",)
    same(load_mesh(path), found.meshes[0])


@pytest.mark.parametrize("record", [PART, MESH_DATA], ids=lambda record: record.made.__name__)
def test_every_field_has_its_row(record: object) -> None:
    assert {each.name for each in dataclasses.fields(record.made)} == set(record.rows)
