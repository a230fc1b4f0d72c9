"""twin.world.meshes.kept_files: files are parsed once per content, and never an old one taken."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from twin.world import kept as keeping
from twin.world.meshes import kept_files as module
from twin.world.meshes.apart import SceneFiles, read_files
from twin.world.meshes.kept_files import kept_files
from twin.world.scene import Scene, load_scene

WALL = "mtllib wall.mtl\nv 0 0 0\nv 2 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
WALL += "usemtl wall\nf 1/1 2/2 3/3\n"


@pytest.fixture
def reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """An empty cache; how often files were parsed."""
    monkeypatch.setattr(keeping, "kept_folder", lambda name: tmp_path / "cache" / name)
    found: list[int] = []

    def counted(scene: Scene) -> SceneFiles:
        found.append(1)
        return read_files(scene)

    monkeypatch.setattr(module, "read_files", counted)
    return found


def scene(folder: Path) -> Scene:
    """A scene with a mesh that stands twice in it, its picture, and terrain."""
    folder.mkdir(exist_ok=True)
    if not (folder / "wall.obj").exists():
        (folder / "wall.obj").write_text(WALL)
        (folder / "wall.mtl").write_text("newmtl wall\nmap_Kd .\\wall.png\n")
        Image.new("RGB", (4, 4), (200, 100, 50)).save(folder / "wall.png")
        np.save(folder / "hill.npy", np.zeros((3, 4)))
    keys = {
        "meshes": [{"file": "wall.obj"}, {"file": "wall.obj", "scale": 2}],
        "terrain": {"heightmap": "hill.npy", "size_m": [9, 9]},
    }
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"schema": 1, "scene": "s", **keys}))
    return load_scene(str(path))


def test_they_are_parsed_once_also_from_another_folder(tmp_path: Path, reads: list[int]) -> None:
    first = kept_files(scene(tmp_path / "a"))
    again = [kept_files(scene(tmp_path / "a")), kept_files(scene(tmp_path / "b"))]
    assert len(reads) == 1
    for found in again:
        assert found.meshes[0] is found.meshes[1]
        part, wanted = found.meshes[0].parts[0], first.meshes[0].parts[0]
        assert part.points.tobytes() == wanted.points.tobytes()
        assert part.image is not None
        assert part.image.tolist() == [[[200, 100, 50]] * 4] * 4


@pytest.mark.parametrize("name", ["wall.obj", "wall.mtl", "wall.png", "hill.npy"])
def test_another_content_is_parsed(tmp_path: Path, reads: list[int], name: str) -> None:
    folder = tmp_path / "a"
    kept_files(scene(folder))
    if name == "wall.png":
        Image.new("RGB", (4, 4), (1, 2, 3)).save(folder / name)
    elif name == "hill.npy":
        np.save(folder / name, np.ones((3, 4)))
    else:
        with (folder / name).open("a") as file:
            file.write("# changed\n")
    found = kept_files(scene(folder))
    assert len(reads) == 2
    if name == "wall.png":
        image = found.meshes[0].parts[0].image
        assert image is not None
        assert image[0, 0].tolist() == [1, 2, 3]


def test_a_file_that_changes_meanwhile_is_not_kept(
    tmp_path: Path, reads: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    own = scene(tmp_path / "a")

    def changing(scene: Scene) -> SceneFiles:
        found = read_files(scene)
        (tmp_path / "a" / "wall.png").unlink()
        return found

    monkeypatch.setattr(module, "read_files", changing)
    with pytest.raises(ValueError, match="changed while it was read"):
        kept_files(own)
    assert not list(tmp_path.glob("cache/meshes/*"))


def test_what_cannot_be_read_is_the_same_line(tmp_path: Path, reads: list[int]) -> None:
    own = scene(tmp_path / "a")
    (tmp_path / "a" / "wall.obj").unlink()
    os.mkfifo(tmp_path / "a" / "wall.obj")
    with pytest.raises(ValueError, match=r"^meshes\[0\]: .*wall\.obj: a named pipe"):
        kept_files(own)
    assert len(reads) == 1
