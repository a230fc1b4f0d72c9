"""Scene and vehicle files given by path: a changed file is another case, and is noticed."""

import json
import shutil
from pathlib import Path

import pytest

import twin
from conductor.run.source import load
from schemas.files.assets import asset_digest, asset_files, mesh_files
from schemas.files.yaml_file import YamlError
from schemas.identity import case_digest, rig_key
from twin.base.errors import RefusedError, UsageError
from twin.rig.engine import Engine
from twin.vehicle.vehicle_file import load_vehicle

SHIPPED = Path(twin.__file__).parent / "vehicle" / "models"
CAMPAIGN = """
campaign: own
scenario: {vehicle: %s, duration_s: 0.2}
camera: {width: 32, height: 18}
matrix: {weather: [clear]}
"""


@pytest.fixture
def files(tmp_path):
    car = tmp_path / "car.yaml"
    shutil.copy(SHIPPED / "opencav.yaml", car)
    campaign = tmp_path / "own.yaml"
    campaign.write_text(CAMPAIGN % car)
    return campaign, car


def test_another_content_is_another_case(files):
    campaign, car = files
    before = load(str(campaign)).cases[0]
    assert before.rig.files == {str(car): asset_digest(car)}
    car.write_text(car.read_text().replace("width_m: 2.", "width_m: 1.9"))
    after = load(str(campaign)).cases[0]
    assert case_digest(before) != case_digest(after)
    assert rig_key(before) != rig_key(after)


def test_a_simulator_refuses_other_content(files):
    campaign, car = files
    case = load(str(campaign)).cases[0]
    Engine(case, 1).close()
    car.write_text(car.read_text() + "\n# changed\n")
    with pytest.raises(RefusedError, match=r"car\.yaml: it, or a file it names, is not what"):
        Engine(case, 1)


def test_shipped_files_need_no_digest():
    assert load("aeb-demo").cases[0].rig.files == {}


def test_files_that_files_name_count(tmp_path):
    scene = tmp_path / "scene.yaml"
    (tmp_path / "m").mkdir()
    scene.write_text("meshes: [{file: m/a.obj}, {file: b.gltf}]\nterrain: {heightmap: h.png}\n")
    (tmp_path / "m" / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\n")
    (tmp_path / "m" / "a.mtl").write_text("newmtl x\nmap_Kd -s 1 1 wall.png\n")
    (tmp_path / "m" / "wall.png").write_bytes(b"1")
    uris = '{"buffers": [{"uri": "b.bin"}, {"uri": "data:,x"}], "images": [{"uri": "c.png"}]}'
    (tmp_path / "b.gltf").write_text(uris)
    (tmp_path / "b.bin").write_bytes(b"2")
    (tmp_path / "h.png").write_bytes(b"3")
    names = {str(file.relative_to(tmp_path)) for file in asset_files(scene)}
    wanted = {"scene.yaml", "m/a.obj", "m/a.mtl", "m/wall.png", "b.gltf", "b.bin", "h.png"}
    assert names == wanted
    for name in ("m/wall.png", "b.bin", "h.png"):
        before = asset_digest(scene)
        (tmp_path / name).write_bytes(b"other")
        assert asset_digest(scene) != before, name


def test_a_copied_folder_has_the_same_digest(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    first.mkdir()
    (first / "scene.yaml").write_text("meshes: [{file: x.stl}]\n")
    (first / "x.stl").write_bytes(b"solid")
    shutil.copytree(first, second)
    assert asset_digest(first / "scene.yaml") == asset_digest(second / "scene.yaml")


def test_broken_files_are_one_line(files):
    campaign, car = files
    car.write_text("a: [")
    with pytest.raises(UsageError, match=r"car\.yaml"):
        load(str(campaign))


def test_other_files_that_a_mesh_names(tmp_path):
    tree = {"buffers": [{"uri": "a%20b.bin"}, {"uri": "data:x"}], "images": [{"uri": "c.png"}]}
    path = tmp_path / "m.gltf"
    path.write_text(json.dumps(tree))
    assert [p.name for p in mesh_files(path)] == ["m.gltf", "a b.bin", "c.png"]
    ply = tmp_path / "m.ply"
    ply.write_text("ply\ncomment TextureFile scan.jpg\nend_header\n")
    assert [p.name for p in mesh_files(ply)] == ["m.ply", "scan.jpg"]
    assert mesh_files(tmp_path / "gone.obj") == [tmp_path / "gone.obj"]


def test_a_lidar_profile_by_path_belongs_to_the_vehicle(files):
    campaign, car = files
    folder = car.parent / "scanners"
    folder.mkdir()
    shutil.copy(SHIPPED.parents[1] / "sensors/lidar/profiles/spinning_16.yaml", folder / "own.yaml")
    car.write_text(car.read_text().replace("profile: spinning_32", "profile: scanners/own.yaml"))
    before = asset_digest(car)
    assert load_vehicle(str(car)).lidar("roof").profile == str(folder / "own.yaml")
    campaign.write_text(campaign.read_text() + "lidars: [{name: roof}]\n")
    engine = Engine(load(str(campaign)).cases[0], 1)
    assert engine.lidar_sites[0].channels == 16
    own = folder / "own.yaml"
    own.write_text(own.read_text().replace("noise_m: ", "noise_m: 1"))
    assert asset_digest(car) != before


def test_an_alias_that_holds_itself_is_one_line(files):
    campaign, car = files
    car.write_text(car.read_text() + "\nx: &x [*x]\n")
    with pytest.raises(UsageError, match="alias that holds itself"):
        load(str(campaign))


def test_the_digest_does_not_depend_on_how_the_path_is_written(tmp_path, monkeypatch):
    (tmp_path / "scene.yaml").write_text("meshes: [{file: x.stl}]\n")
    (tmp_path / "x.stl").write_bytes(b"solid")
    whole = asset_digest(tmp_path / "scene.yaml")
    monkeypatch.chdir(tmp_path)
    assert asset_digest(Path("scene.yaml")) == asset_digest(Path("./scene.yaml")) == whole


def test_binary_gltf_and_long_obj_files_name_theirs(tmp_path):
    chunk = b'{"images": [{"uri": "c.png"}]}'
    header = b"glTF" + (2).to_bytes(4, "little") + (20 + len(chunk)).to_bytes(4, "little")
    glb = tmp_path / "m.glb"
    glb.write_bytes(header + len(chunk).to_bytes(4, "little") + b"JSON" + chunk)
    assert [p.name for p in mesh_files(glb)] == ["m.glb", "c.png"]
    obj = tmp_path / "m.obj"
    obj.write_bytes(b"v 0 0 0\n" * 1000 + b"mtllib late.mtl\n")
    assert [p.name for p in mesh_files(obj)] == ["m.obj", "late.mtl"]


TEXTURES = {
    # What stands in a material library -> the picture that is meant.
    "map_Kd wall.png": "wall.png",
    "map_Kd pictures/wall.png": "pictures/wall.png",
    "map_Kd ./wall.png": "wall.png",
    "map_Kd .\\wall.jpg": "wall.jpg",
    "map_Kd pictures\\old\\wall.jpg": "pictures/old/wall.jpg",
    "map_Kd C:\\Users\\me\\wall.jpg": "wall.jpg",
    "map_Kd /home/me/wall.jpg": "wall.jpg",
    "map_Kd -s 1 1 1 wall.png": "wall.png",
    "map_Kd -clamp on -o 0.5 0.5 -mm 0 1 my wall.png": "my wall.png",
    "map_Kd -s 2 2 .\\pictures\\my wall.png": "pictures/my wall.png",
    "  MAP_KD\twall.png  ": "wall.png",
    "map_Kd ../beside/wall.png": "../beside/wall.png",
    "map_Bump -bm 0.3 rough.png": "rough.png",
    "norm rough.png": "rough.png",
    "map_Kd Mauer\xfc.png": "Mauer\xfc.png",
}


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
@pytest.mark.parametrize("line", TEXTURES)
def test_a_picture_of_a_material_library_counts(tmp_path, line, encoding):
    folder = tmp_path / "m"
    picture = folder / TEXTURES[line]
    folder.mkdir()
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(b"1")
    scene = tmp_path / "scene.yaml"
    scene.write_text("meshes: [{file: m/a.obj}]\n")
    (folder / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\n")
    (folder / "a.mtl").write_bytes(f"# gr\xf6\xdfer\nnewmtl x\n{line}\n".encode(encoding))
    before = asset_digest(scene)
    picture.write_bytes(b"2")
    assert asset_digest(scene) != before


@pytest.mark.parametrize("line", ["mtllib\ta.mtl", "  mtllib a.mtl", "mtllib .\\a.mtl"])
def test_a_material_library_counts_however_it_is_named(tmp_path, line):
    (tmp_path / "a.mtl").write_text("newmtl x\n")
    (tmp_path / "m.obj").write_text(f"v 0 0 0\n{line}\n")
    assert tmp_path / "a.mtl" in [path.resolve() for path in mesh_files(tmp_path / "m.obj")]


def test_pictures_lie_beside_the_mesh_or_beside_its_library(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "m.obj").write_text("mtllib lib/a.mtl\n")
    (tmp_path / "lib" / "a.mtl").write_text("newmtl x\nmap_Kd x.png\n")
    assert {tmp_path / "x.png", tmp_path / "lib" / "x.png"} < set(mesh_files(tmp_path / "m.obj"))


@pytest.mark.parametrize(
    ("uri", "name"),
    [("w%20all%C3%BC.png", "w all\xfc.png"), ("p/w.png", "p/w.png"), ("./p/../w.png", "w.png")],
)
def test_a_percent_encoded_uri_of_a_gltf_counts(tmp_path, uri, name):
    (tmp_path / "p").mkdir()
    (tmp_path / "m.gltf").write_text(json.dumps({"images": [{"uri": uri}]}))
    picture = tmp_path / name
    picture.write_bytes(b"1")
    scene = tmp_path / "scene.yaml"
    scene.write_text("meshes: [{file: m.gltf}]\n")
    before = asset_digest(scene)
    picture.write_bytes(b"2")
    assert asset_digest(scene) != before


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_a_picture_of_a_ply_counts(tmp_path, encoding):
    head = "ply\nformat ascii 1.0\ncomment gr\xf6\xdfer\ncomment TextureFile p\\w\xfc.png\n"
    (tmp_path / "m.ply").write_bytes(f"{head}end_header\n".encode(encoding))
    assert tmp_path / "p" / "w\xfc.png" in mesh_files(tmp_path / "m.ply")


@pytest.mark.parametrize(
    "line",
    ["map_Kd a" + " " * 2_000_000 + "b", "map_Kd " + "-o " * 500_000, "map_" + "a" * 2_000_000],
)
def test_a_line_that_is_made_to_take_long_names_nothing(tmp_path, line):
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n")
    (tmp_path / "a.mtl").write_text(f"newmtl x\n{line}\nmap_Kd wall.png\n")
    found = mesh_files(tmp_path / "a.obj")
    assert found == [tmp_path / "a.obj", tmp_path / "a.mtl", tmp_path / "wall.png"]


def test_names_in_a_file_are_those_of_its_content(tmp_path):
    path = tmp_path / "scenario.yaml"
    for name in ("one.xodr", "two.xodr"):
        (tmp_path / name).write_text(name)
    for name in ("one", "two", "one"):
        path.write_text(f"road: {name}.xodr\n")
        for _ in range(2):
            assert [file.name for file in asset_files(path)] == ["scenario.yaml", f"{name}.xodr"]
    (tmp_path / "one.xodr").unlink()
    assert [file.name for file in asset_files(path)] == ["scenario.yaml"]
    path.write_text("road: [")
    with pytest.raises(YamlError):
        asset_files(path)
    path.unlink()
    with pytest.raises(YamlError):
        asset_files(path)
