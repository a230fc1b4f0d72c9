"""Scenes and vehicles that cannot be used, each broken in one way, and what its line must say."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

import twin

SHIPPED = Path(twin.__file__).parent / "vehicle" / "models" / "opencav.yaml"
TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]], "<f4")
OBJ = "v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n2 0 0\n0 3 0\n"
)

Broken = Callable[[Path], str]
"""Writes a file of this name into a folder and says what the scene file adds to name it."""


def gltf(
    points: np.ndarray = TRIANGLE, indices: tuple[int, ...] = (0, 1, 2), **more: object
) -> str:
    """A triangle as a glTF file that holds its own data, with ``more`` at its top."""
    data = points.tobytes() + np.array(indices, "<u4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    material = {"material": 0} if "materials" in more else {}
    attributes = {"POSITION": 0, **({"TEXCOORD_0": 2} if material else {})}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 1, **material}]}],
        "buffers": [{"byteLength": 48, "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
            {"buffer": 0, "byteOffset": 0, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        **more,
    }
    return json.dumps(tree)


def _pictured(image: str) -> dict[str, object]:
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    return {"materials": [look], "textures": [{"source": 0}], "images": [{"uri": image}]}


def _picture(mode: str, size: tuple[int, int] = (40, 30)) -> bytes:
    noise = np.random.default_rng(1).integers(0, 256, (size[1], size[0], len(mode)), np.uint8)
    stream = io.BytesIO()
    Image.fromarray(noise.squeeze(), mode).save(stream, "PNG")
    return stream.getvalue()


def _mesh(name: str, content: str | bytes, **more: object) -> Broken:
    def write(folder: Path) -> str:
        _put(folder / name, content)
        return json.dumps({"meshes": [{"file": name, **more}]})

    return write


def _textured(name: str, picture: bytes | None) -> Broken:
    def write(folder: Path) -> str:
        image = f"{Path(name).stem}.png"
        if picture is not None:
            _put(folder / image, picture)
        _put(folder / name, gltf(**_pictured(image)))
        return json.dumps({"meshes": [{"file": name}]})

    return write


def _terrain(name: str, content: bytes | np.ndarray | None) -> Broken:
    def write(folder: Path) -> str:
        if isinstance(content, np.ndarray):
            np.save(folder / name, content)
        elif content is not None:
            _put(folder / name, content)
        return json.dumps({"terrain": {"heightmap": name, "size_m": [100, 100]}})

    return write


def _special(name: str, make: Callable[[Path], object]) -> Broken:
    def write(folder: Path) -> str:
        make(folder / name)
        return json.dumps({"meshes": [{"file": name}]})

    return write


def _piped(name: str) -> Broken:
    def write(folder: Path) -> str:
        os.mkfifo(folder / "pipe.png")
        _put(folder / name, gltf(**_pictured("pipe.png")))
        return json.dumps({"meshes": [{"file": name}]})

    return write


def _put(path: Path, content: str | bytes) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def _keys(**more: object) -> Broken:
    return lambda _folder: json.dumps(more)


DRACO = "KHR_draco_mesh_compression"
WALKER = {"kind": "pedestrian", "waypoints": [[9, 9], [9, 0]]}
FAR = np.array([[0, 0, 0], [9000, 0, 0], [0, 3, 0]], "<f4")
BROKEN_SCENES: dict[str, tuple[Broken, tuple[str, ...]]] = {
    # What is broken -> how it is written, and words of the line about it.
    "mesh-missing": (_keys(meshes=[{"file": "gone.glb"}]), ("gone.glb", "No such file")),
    "mesh-cut-off": (_mesh("cut.gltf", gltf()[:-40]), ("cut.gltf", "JSON cannot be read")),
    "mesh-noise": (_mesh("noise.glb", b"\x07" * 500), ("noise.glb", "no GLB header")),
    "mesh-empty": (_mesh("empty.obj", b""), ("empty.obj", "the file is empty")),
    "mesh-no-faces": (_mesh("points.obj", OBJ[:-8]), ("points.obj", "no faces")),
    "mesh-format": (_mesh("notes.txt", b"hello"), ("notes.txt", "not a mesh format")),
    "mesh-nan": (_mesh("nan.obj", OBJ.replace("2 0 0", "nan 0 0")), ("nan.obj", "NaN")),
    "mesh-index": (_mesh("index.ply", PLY + "3 0 1 7\n"), ("index.ply", "1 faces name vertices")),
    "mesh-far": (_mesh("far.gltf", gltf(FAR)), ("far.gltf", "reaches 9000 m")),
    "mesh-scaled-far": (_mesh("out.obj", OBJ, scale=3000), ("out.obj", "reaches 9000 m")),
    "mesh-folder": (_special("folder.obj", Path.mkdir), ("folder.obj", "a folder")),
    "mesh-fifo": (_special("pipe.glb", os.mkfifo), ("pipe.glb", "a named pipe")),
    "mesh-device": (
        _special("zero.obj", lambda path: path.symlink_to("/dev/zero")),
        ("zero.obj", "a device"),
    ),
    "gltf-extension": (
        _mesh("magic.gltf", gltf(extensionsRequired=["EXT_magic"])),
        ("magic.gltf", "requires the extension EXT_magic"),
    ),
    "gltf-draco": (  # with the decoder it is its data that cannot be read
        _mesh(
            "draco.gltf",
            gltf(
                extensionsRequired=[DRACO],
                meshes=[
                    {
                        "primitives": [
                            {
                                "attributes": {"POSITION": 0},
                                "indices": 1,
                                "extensions": {
                                    DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}
                                },
                            }
                        ]
                    }
                ],
            ),
        ),
        ("draco.gltf", "Draco"),
    ),
    "texture-missing": (_textured("bare.gltf", None), ("bare.gltf", "bare.png", "No such file")),
    "texture-cut-off": (
        _textured("half.gltf", _picture("RGB")[:900]),
        ("half.gltf", "a texture cannot be read"),
    ),
    "texture-fifo": (_piped("piped.gltf"), ("piped.gltf", "pipe.png", "a named pipe")),
    "terrain-missing": (_terrain("gone.png", None), ("gone.png", "No such file")),
    "terrain-large": (_terrain("large.npy", np.zeros((3, 1025))), ("large.npy", "3 x 1025")),
    "terrain-cut-off": (_terrain("cut.png", _picture("L")[:500]), ("cut.png", "not a PNG file")),
    "terrain-colours": (_terrain("rgb.png", _picture("RGB")), ("rgb.png", "one channel")),
    "terrain-nan": (_terrain("nan.npy", np.full((3, 3), np.nan)), ("nan.npy", "NaN")),
    "unknown-key": (_keys(obstacel={"x_m": 200}), ("unknown-key.yaml", "'obstacle'?")),
    "not-a-number": (_keys(seed="many"), ("not-a-number.yaml", "seed")),
    "no-ground": (_keys(street=False), ("no-ground.yaml", "needs other ground")),
    "no-speed": (_keys(objects=[WALKER]), ("no-speed.yaml", "speed_mps")),
}
"""Scenes by name; each is a file of that name."""

BROKEN_VEHICLES: dict[str, tuple[str, str, str]] = {
    # What is broken -> what of the shipped file becomes what, and a word of the line about it.
    "track": ("track_m: 1.734", "track_m: -1", "track_m: given -1"),
    "mass": ("  mass_kg: 42.0", "  mass_kg: -42.0", "wheels.mass_kg: given -42"),
    "missing-key": ("wheelbase_m: 3.09", "", "wheelbase_m"),
    "unknown-key": ("  mass_kg: 42.0", "  weight_kg: 42.0", "weight_kg"),
    "text": ("track_m: 1.734", "track_m: wide", "track_m: given 'wide'"),
    "nan": ("track_m: 1.734", "track_m: .nan", "track_m: given nan"),
    "flat": ("gyration_y: 0.76", "gyration_y: 1.0e-200", "inertia"),
    "diagonal": ("[523.0, 523.0, 412.5, 412.5]", "[2000, 1.0e-9, 1.0e-9, 2000]", "inertia"),
    "brakes": ("distance_60mph_m: 46.5", "distance_60mph_m: 2.0", "distance_60mph_m 2"),
    "no-yaml": ("schema: 3", "schema: [3", "no-yaml.yaml"),
}
"""Vehicles by name; each is a file of that name."""


def write_scene(folder: Path, name: str) -> Path:
    """The scene file of this name with the files it names, in a folder of its own."""
    own = folder / name
    own.mkdir(parents=True)
    more = json.loads(BROKEN_SCENES[name][0](own))
    path = own / f"{name}.yaml"
    bare = {"furniture": {"parked_cars": 0.0}}  # they take most of the time
    path.write_text(json.dumps({"schema": 1, "scene": name, **bare, **more}))
    return path


def write_vehicle(folder: Path, name: str) -> Path:
    """The vehicle file of this name."""
    text, (old, new, _) = SHIPPED.read_text(), BROKEN_VEHICLES[name]
    assert old in text
    path = folder / f"{name}.yaml"
    path.write_text(text.replace(old, new))
    return path
