"""What is left out of a mesh file is told where its scene is shown and where it is run."""

import yaml
from unit.twin.world.meshes.gltf.gltf_files import SQUARE, GltfFile

NOTES = [
    "wall.glb: extension KHR_lights_punctual ignored",
    r"wall.glb: extension EXT_a\n\x1b[31mb ignored",
    "wall.glb: animations ignored",
    "wall.glb: lines left out",
]
"""One line each, however often the file stands in the scene."""


def scene_with_notes(folder):
    """A scene file that shows one mesh file twice."""
    file = GltfFile()
    row = file.primitive(SQUARE)
    file.tree["meshes"][0]["primitives"] += [{**row, "mode": 1}] * 2
    file.tree["animations"] = [{}]
    file.tree["extensionsUsed"] = ["KHR_lights_punctual", "EXT_a\n\x1b[31mb"]
    file.write(folder / "wall.glb")
    meshes = [{"file": "wall.glb", "position_m": [x, 12.0, 0.0]} for x in (40.0, 50.0)]
    path = folder / "noted.yaml"
    path.write_text(yaml.safe_dump({"schema": 1, "scene": "noted", "meshes": meshes}))
    return path


def told_in(text):
    """Lines about the file."""
    return [line for line in text.splitlines() if "wall.glb" in line]


def test_what_is_left_out_is_a_line_per_file_and_feature(marked, tmp_path):
    scene = scene_with_notes(tmp_path)
    shown = marked.run(
        *("twin", "snapshot", "--scene", str(scene), "--out", str(tmp_path / "noted.jpg")),
        *("--weather", "clear", "--time", "13:00"),
    )
    assert shown.returncode == 0, shown.stderr
    assert told_in(shown.stderr) == NOTES
    checked = marked.run("twin", "validate", "scene", str(scene))
    assert (checked.returncode, told_in(checked.stderr)) == (0, NOTES)
    data = {
        "campaign": "noted",
        "scenario": {"scene": str(scene), "duration_s": 1},
        "camera": {"width": 64, "height": 36, "hz": 10, "reflections": False},
        "matrix": {"weather": ["clear"]},
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(data))
    for _ in range(2):  # also of files that were good before
        checked = marked.run("conductor", "validate", str(tmp_path / "c.yaml"))
        assert (checked.returncode, told_in(checked.stderr)) == (0, NOTES)
    out = tmp_path / "run"
    done = marked.run(
        *("conductor", "run", str(tmp_path / "c.yaml"), "--workers", "1", "--out", str(out)),
        *("--view", "none"),
    )
    assert done.returncode == 0, done.stderr
    assert told_in(done.stderr) == NOTES
    log = (out / "logs" / "worker-1.log").read_text().splitlines()
    first = next(i for i, line in enumerate(log) if line.startswith("rig ready"))
    assert log[first + 1 : first + 1 + len(NOTES)] == NOTES
    assert sum("wall.glb" in line for line in log) == len(NOTES)
