"""Small glTF files, written part by part."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], "<f4")


class GltfFile:
    """A document and its only buffer."""

    def __init__(self) -> None:
        """One scene with one node that shows the first mesh."""
        self.bytes = b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": []}],
            "accessors": [],
            "bufferViews": [],
        }

    def view(self, data: bytes, **more: Any) -> int:
        """Add bytes; the number of their buffer view."""
        self.bytes += bytes(-len(self.bytes) % 4)
        row = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data), **more}
        self.tree["bufferViews"].append(row)
        self.bytes += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: Any, dtype: str = "f4", **more: Any) -> int:
        """Add an array; the number of its accessor."""
        array = np.asarray(values, f"<{dtype}")
        width = 1 if array.ndim == 1 else array.shape[1]
        shape = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[width]
        row = {"componentType": CODES[dtype], "type": shape, "count": len(array)}
        row["bufferView"] = self.view(array.tobytes())
        self.tree["accessors"].append({**row, **more})
        return len(self.tree["accessors"]) - 1

    def primitive(
        self, points: Any = SQUARE, corners: Any = (0, 1, 2, 0, 2, 3), **more: Any
    ) -> dict:
        """Add a primitive to the first mesh; its row."""
        row = {"attributes": {"POSITION": self.accessor(points)}, **more}
        if corners is not None:
            row["indices"] = self.accessor(corners, "u2")
        self.tree["meshes"][0]["primitives"].append(row)
        return row

    def write(self, path: Path) -> Path:
        """As .gltf with a .bin beside it, or as .glb."""
        buffer: dict[str, Any] = {"byteLength": len(self.bytes)}
        if path.suffix == ".gltf":
            buffer["uri"] = f"{path.stem}.bin"
            (path.parent / f"{path.stem}.bin").write_bytes(self.bytes)
        text = json.dumps({**self.tree, "buffers": [buffer]})
        if path.suffix == ".gltf":
            path.write_text(text)
            return path
        content, data = text.encode(), self.bytes + bytes(-len(self.bytes) % 4)
        content += b" " * (-len(content) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(content) + len(data))
        chunk = struct.pack("<I4s", len(content), b"JSON") + content
        path.write_bytes(head + chunk + struct.pack("<I4s", len(data), b"BIN\0") + data)
        return path
