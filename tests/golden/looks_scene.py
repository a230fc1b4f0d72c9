"""A yard that shows what glTF materials can be: written by this file, part by part.

From left to right: a wire fence that is holes in a picture before a striped wall, a ball of few
smooth facets, a panel whose colours lie at its corners, a wall with bumps and mirrors in maps, and
a sign that shines.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image
from unit.twin.world.meshes.gltf.gltf_files import GltfFile

SCENE = """schema: 1
scene: yard
street: false
obstacle: null
meshes:
  - {file: ground.glb, up: z, semantic: road, material: asphalt, color: [0.10, 0.10, 0.105]}
  - {file: yard.glb, up: z, semantic: wall}
"""
_REPEAT, _CLAMP, _MIRRORED = 10497, 33071, 33648


def write_yard(folder: Path, wall_parts: int = 1) -> Path:
    """Write the files; the path of the scene. ``wall_parts``: one above the other, each with faces
    of its own."""
    ground = GltfFile()
    quad(ground, (-20, 40, 0), (-20, -40, 0), (120, 0, 0))
    ground.write(folder / "ground.glb")
    yard = GltfFile()
    yard.tree |= {"materials": [], "textures": [], "samplers": [], "images": []}
    fence(yard)
    ball(yard)
    panel(yard)
    wall(yard, wall_parts)
    sign(yard)
    yard.write(folder / "yard.glb")
    scene = folder / "yard.yaml"
    scene.write_text(SCENE)
    return scene


def texture(file, pixels, wraps=(_REPEAT, _REPEAT)):
    """Add a picture uint8 [h, w, 3 or 4]; the number of its texture."""
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    tree = file.tree
    tree["images"].append({"bufferView": file.view(out.getvalue()), "mimeType": "image/png"})
    tree["samplers"].append({"wrapS": wraps[0], "wrapT": wraps[1]})
    tree["textures"].append(
        {"source": len(tree["images"]) - 1, "sampler": len(tree["samplers"]) - 1}
    )
    return len(tree["textures"]) - 1


def material(file, surface, **more):
    """Add a material; its number."""
    file.tree["materials"].append({"pbrMetallicRoughness": surface, "doubleSided": True, **more})
    return len(file.tree["materials"]) - 1


def quad(file, origin, right_end, up, *, uv_max=(1, 1), top_v=0, **more):
    """A quadrilateral from its lower left corner to its lower right one, and by ``up``."""
    a, b, up = (np.array(v, float) for v in (origin, right_end, up))
    row = file.primitive(np.array([a, b, b + up, a + up]), **more)
    u, v = uv_max
    row["attributes"]["TEXCOORD_0"] = file.accessor([[0, v], [u, v], [u, top_v], [0, top_v]])
    return row


def fence(file):
    """Crossed wires in a picture of 64 x 64, nothing between them, before red and white stripes."""
    y, x = np.mgrid[0:64, 0:64]
    wires = (np.minimum((x + y) % 32, -(x + y) % 32) < 3) | (
        np.minimum((x - y) % 32, (y - x) % 32) < 3
    )
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[..., :3] = (60, 66, 72)
    pixels[..., 3] = 255 * wires
    wire = material(file, {"baseColorTexture": {"index": texture(file, pixels)}}, alphaMode="MASK")
    quad(file, (9, 6.2, 0), (9, 3.2, 0), (0, 0, 2), uv_max=(6, 4), material=wire)
    stripes = np.zeros((1, 32, 3), np.uint8)
    stripes[0, :16], stripes[0, 16:] = (190, 30, 25), (225, 225, 220)
    behind = material(file, {"baseColorTexture": {"index": texture(file, stripes)}})
    quad(file, (12, 8.5, 0), (12, 4.5, 0), (0, 0, 2.6), uv_max=(4, 1), material=behind)


def ball(file):
    """A ball of 10 x 6 facets with the normals of a sphere."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, 11), np.linspace(-np.pi / 2, np.pi / 2, 7))
    normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    i, j = (a.ravel() for a in np.meshgrid(range(6), range(10), indexing="ij"))
    a, b = 11 * i + j, 11 * (i + 1) + j
    lower, upper = np.stack([a, a + 1, b + 1], 1), np.stack([a, b + 1, b], 1)
    corners = np.concatenate([lower[i > 0], upper[i < 5]])  # the others have no area at a pole
    clay = material(file, {"baseColorFactor": [0.55, 0.42, 0.12, 1], "metallicFactor": 0})
    points = normal.reshape(-1, 3) + np.array([9, 1.6, 1.0])
    row = file.primitive(points, corners.ravel(), material=clay)
    row["attributes"]["NORMAL"] = file.accessor(normal.reshape(-1, 3))


def panel(file):
    """Colours at the corners, times a picture of rings that ends in mirrored copies of itself."""
    y, x = np.mgrid[0:32, 0:32]
    rings = np.uint8(140 + 115 * (np.hypot(x, y) % 16 < 9))
    index = texture(file, np.dstack([rings] * 3), (_MIRRORED, _MIRRORED))
    look = material(file, {"baseColorTexture": {"index": index}, "metallicFactor": 0})
    row = quad(file, (9, 0, 0), (9, -2, 0), (0, 0, 2), uv_max=(2, 2), material=look)
    colors = [[0.9, 0.05, 0.05], [0.05, 0.8, 0.1], [0.05, 0.1, 0.9], [0.9, 0.9, 0.1]]
    row["attributes"]["COLOR_0"] = file.accessor(colors)


def wall(file, parts=1):
    """Studs in a normal map; the upper half a polished metal, the lower half matt paint."""
    size = 128
    y, x = (np.mgrid[0:size, 0:size] % 32 - 15.5) / 11.0
    inside = np.hypot(x, y) < 1.0
    bumps = np.dstack([np.where(inside, 0.7 * x, 0), np.where(inside, -0.7 * y, 0)])
    normal = np.dstack([bumps, np.sqrt(1.0 - (bumps**2).sum(axis=2))])
    bump = texture(file, np.uint8(np.rint(127.5 + 127.5 * normal)))
    shine = np.zeros((2, 1, 3), np.uint8)
    shine[0, 0], shine[1, 0] = (0, 26, 255), (0, 255, 0)
    polished = texture(file, shine, (_CLAMP, _CLAMP))
    repeat = {"KHR_texture_transform": {"scale": [2, 1.5]}}
    look = material(
        file,
        {
            "baseColorFactor": [0.75, 0.70, 0.62, 1],
            "metallicRoughnessTexture": {"index": polished},
        },
        normalTexture={"index": bump, "extensions": repeat},
    )
    height = 2.2 / parts
    for k in range(parts):
        low, uv_max = k * height, (1, 1 - k / parts)
        ends = (9, -2.6, low), (7.5, -5, low)
        top_v = 1 - (k + 1) / parts
        quad(file, *ends, (0, 0, height), uv_max=uv_max, top_v=top_v, material=look)


def sign(file):
    """An arrow of light on black."""
    pixels = np.zeros((16, 24, 3), np.uint8)
    pixels[6:10, 3:14] = (40, 255, 90)
    for k in range(7):
        pixels[1 + k : 15 - k, 14 + k] = (40, 255, 90)
    look = material(
        file,
        {"baseColorFactor": [0.02, 0.02, 0.02, 1], "metallicFactor": 0},
        emissiveFactor=[1, 1, 1],
        emissiveTexture={"index": texture(file, pixels, (_CLAMP, _CLAMP))},
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}},
    )
    file.tree["extensionsUsed"] = ["KHR_materials_emissive_strength", "KHR_texture_transform"]
    quad(file, (9, -1.0, 2.5), (9, -4.0, 2.5), (0, 0, 1.6), material=look)
