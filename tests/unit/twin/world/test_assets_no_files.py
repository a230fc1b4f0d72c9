"""Scenes, vehicles, lidar profiles, meshes, models and records that are devices, pipes or giants:
one line, and nothing is read."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from devkit.darknet.importer import darknet_model
from devkit.darknet.sections import read_sections
from devkit.detector.description import read_description
from devkit.detector.detector import Detector
from schemas.files.assets import FILE_BYTES_MAX, asset_digest, file_digest
from twin.base.errors import InfrastructureError, UsageError
from twin.base.picture_file import read_picture
from twin.records.drive_record import RecordReader
from twin.records.kpi_file import read_kpi
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.stack_identity.stack_class import class_mistakes
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.meshes.mesh_file import load_mesh
from twin.world.meshes.terrain import read_samples
from twin.world.scene import load_scene

ZERO = Path("/dev/zero")

READERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "lidar profile": (lambda path: load_lidar_profile(str(path)), "a.yaml"),
    "scene": (lambda path: load_scene(str(path)), "a.yaml"),
    "vehicle": (lambda path: load_vehicle(str(path)), "a.yaml"),
    "mesh": (load_mesh, "a.obj"),
    "mesh with a header": (load_mesh, "a.glb"),
    "model": (Detector, "a.onnx"),
    "description": (read_description, "a.json"),
    "cfg": (read_sections, "a.cfg"),
    "picture": (read_picture, "a.png"),
    "heights": (read_samples, "a.npy"),
    "record": (RecordReader, "a.drive"),
    "KPI": (read_kpi, "a.parquet"),
}
each = pytest.mark.parametrize(("read", "name"), READERS.values(), ids=READERS)


@each
def test_a_device_is_one_line(tmp_path: Path, read: Callable[[Path], object], name: str) -> None:
    (tmp_path / name).symlink_to(ZERO)
    with pytest.raises((UsageError, ValueError, InfrastructureError), match="a device") as caught:
        read(tmp_path / name)
    assert len(str(caught.value).splitlines()) == 1
    assert name in str(caught.value)


@each
def test_a_pipe_is_not_waited_for(
    tmp_path: Path, read: Callable[[Path], object], name: str
) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises((UsageError, ValueError, InfrastructureError), match="a named pipe"):
        read(tmp_path / name)


def test_what_a_mesh_names_is_looked_at_before_it_is_read(tmp_path: Path) -> None:
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + triangle)
    os.mkfifo(tmp_path / "a.mtl")
    with pytest.raises(ValueError, match=r"a\.obj: it names .*a\.mtl: a named pipe"):
        load_mesh(tmp_path / "a.obj")
    (tmp_path / "a.mtl").unlink()
    assert len(load_mesh(tmp_path / "a.obj").parts) == 1


def test_weights_that_are_a_device(tmp_path: Path) -> None:

    found = sorted(Path(__file__).parents[4].glob("devkit/darknet/**/*.cfg"))
    assert found
    with pytest.raises(UsageError, match="/dev/zero: a device"):
        darknet_model(found[0], ZERO)


def test_a_digest_of_a_giant_is_not_begun(tmp_path: Path) -> None:
    with (tmp_path / "a.onnx").open("wb") as file:
        file.truncate(FILE_BYTES_MAX + 1)
    with pytest.raises(OSError, match="at most"):
        file_digest(tmp_path / "a.onnx")
    with pytest.raises(OSError, match="a device"):
        file_digest(ZERO)


def test_a_line_without_end_in_a_mesh_takes_no_memory(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("meshes:\n- file: a.obj\n")
    with (tmp_path / "a.obj").open("wb") as file:
        file.truncate(64 << 20)
        file.write(b"\nmtllib none.mtl\n")
    assert len(asset_digest(tmp_path / "s.yaml")) == 64


@pytest.mark.parametrize("content", ["(" * 100_000, "x = " + "-" * 300_000 + "1", "\0", "\n" * 4])
def test_a_stack_that_no_parser_takes_is_left_to_its_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    (tmp_path / "odd_stack.py").write_text(content)
    monkeypatch.chdir(tmp_path)
    found = class_mistakes("odd_stack:Stack", [])
    assert [m.path for m in found] in ([], ["autonomy.stack"])
