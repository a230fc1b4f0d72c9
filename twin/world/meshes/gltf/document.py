"""The JSON of a glTF file and the bytes that it names."""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from schemas.files.regular_file import open_regular
from twin.world.meshes.gltf.meshopt import unpack
from twin.world.meshes.mesh_header import FILE_BYTES_MAX, gltf_json

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
QUANTIZED = "KHR_mesh_quantization"
TRANSFORM = "KHR_texture_transform"
WEBP = "EXT_texture_webp"
BASIS = "KHR_texture_basisu"
EMISSIVE_STRENGTH = "KHR_materials_emissive_strength"

UNDERSTOOD = (DRACO, *MESHOPT, QUANTIZED, TRANSFORM, WEBP, BASIS, EMISSIVE_STRENGTH)
"""Extensions that change what is read."""

LOOKS = ("KHR_materials_", "KHR_lights_punctual", "KHR_animation_pointer", "EXT_lights_")
"""Beginnings of extensions that only change how something looks: without them it is still there."""

_CHUNK_BIN = 0x004E4942
NOTES_MAX = 60
"""Most notes of a file; a file names the extensions that it uses, as many as it likes."""


class GltfError(ValueError):
    """The file breaks the standard, or needs what is not supported; one line without its name."""


@dataclass(slots=True)
class Document:
    """A glTF file that has been opened."""

    path: Path
    data: dict[str, Any]
    notes: dict[str, None] = field(default_factory=dict)
    """What is left out, each once, in the order in which it was met."""
    _chunk: bytes | None = None
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _unpacked: dict[int, bytes] = field(default_factory=dict)
    """Buffer views that were compressed."""

    def note(self, text: str) -> None:
        """Say what is left out."""
        if len(self.notes) > NOTES_MAX:
            text = "and so on"
        self.notes[f"{self.path.name}: {text}"] = None

    def rows(self, key: str) -> list[dict[str, Any]]:
        """An array of objects at the top of the document; empty if it has none.

        Raises:
            GltfError: it is something else.
        """
        found = self.data.get(key, [])
        if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
            raise GltfError(f"'{key}' is no list of objects")
        return found

    def row(self, key: str, index: object) -> dict[str, Any]:
        """One of :meth:`rows`.

        Raises:
            GltfError: there is none of this number.
        """
        rows = self.rows(key)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(rows):
            raise GltfError(f"{key}[{index}] is named, but there are {len(rows)}")
        return rows[index]

    def view(self, index: object) -> tuple[bytes, int]:
        """Bytes of a buffer view, and its stride, 0 if it has none.

        Raises:
            GltfError: they are not there, or compressed and cannot be unpacked.
            OSError: a file cannot be read.
        """
        view = self.row("bufferViews", index)
        stride = whole(view, "byteStride", 0)
        for name in MESHOPT:
            # An uncompressed copy is the same whatever is installed.
            if name in _extensions(view) and not self._has_bytes(view.get("buffer")):
                return self._unpack(name, index, view), stride
        return self._part(view, f"bufferViews[{index}]"), stride

    def _part(self, row: dict[str, Any], name: str) -> bytes:
        """Bytes of a buffer from an offset on."""
        data = self.buffer(row.get("buffer"))
        start, length = whole(row, "byteOffset", 0), whole(row, "byteLength")
        if start + length > len(data):
            raise GltfError(f"{name} ends beyond its buffer of {len(data)} bytes")
        return data[start : start + length]

    def _unpack(self, name: str, index: object, view: dict[str, Any]) -> bytes:
        """Bytes of a compressed buffer view."""
        assert isinstance(index, int)
        if index not in self._unpacked:
            packed = view["extensions"][name]
            if not isinstance(packed, dict):
                raise GltfError(f"bufferViews[{index}]: '{name}' is no object")
            data = self._part(packed, f"bufferViews[{index}], compressed,")
            count, row = whole(packed, "count"), whole(packed, "byteStride")
            try:
                found = unpack(data, packed, count, row)
            except Exception as error:  # the library raises what its C++ parts do
                reason = " ".join(str(error).split())[:80]
                raise GltfError(f"bufferViews[{index}] is compressed ({name}): {reason}") from None
            if len(found) < whole(view, "byteLength"):
                raise GltfError(
                    f"bufferViews[{index}] unpacks to {len(found)} bytes, fewer than it says"
                )
            self._unpacked[index] = found
        return self._unpacked[index]

    def buffer(self, index: object) -> bytes:
        """Bytes of a buffer.

        Raises:
            GltfError: as :meth:`view`.
            OSError: its file cannot be read.
        """
        buffer = self.row("buffers", index)
        assert isinstance(index, int)
        if index not in self._buffers:
            uri = buffer.get("uri")
            if uri is None:
                if index or self._chunk is None:
                    raise GltfError(f"buffers[{index}] has no uri")
                self._buffers[index] = self._chunk
            else:
                self._buffers[index] = self.resource(uri)
        found = self._buffers[index]
        if len(found) < whole(buffer, "byteLength"):
            raise GltfError(f"buffers[{index}] has {len(found)} bytes, fewer than it says")
        return found

    def resource(self, uri: object) -> bytes:
        """What a URI names: data in itself, or a file beside this one.

        Raises:
            GltfError: no such thing.
            OSError: it cannot be read.
        """
        if not isinstance(uri, str):
            raise GltfError("a uri is no text")
        if uri.startswith("data:"):
            _, _, content = uri.partition(";base64,")
            try:
                return base64.b64decode(content, validate=True)
            except binascii.Error:
                raise GltfError("a data uri is not base64") from None
        name = unquote(uri)
        try:
            with open_regular(self.path.parent / name, FILE_BYTES_MAX) as file:
                return file.read()
        except ValueError as error:
            raise GltfError(f"it names {name[:80]!r}: {error}") from None
        except OSError as error:
            raise GltfError(f"it names {name[:80]!r}: {error.strerror or error}") from None

    def _has_bytes(self, index: object) -> bool:
        """Whether there is anything in a buffer: of compressed files it may be a placeholder."""
        return "uri" in self.row("buffers", index) or (index == 0 and self._chunk is not None)


def open_gltf(path: Path) -> Document:
    """Read the JSON and check what the file asks of its reader.

    Raises:
        GltfError: it is no glTF 2 file, or needs an extension that is not supported.
        OSError: it cannot be read.
    """
    try:
        data = gltf_json(path)
    except ValueError as error:
        raise GltfError(str(error)) from None
    asset = data.get("asset")
    version = str(asset.get("version", "")) if isinstance(asset, dict) else ""
    if not version.startswith("2."):
        raise GltfError(f"glTF version {version or 'missing'}, readable: 2.x")
    document = Document(path, data)
    if path.suffix.lower() == ".glb":
        document._chunk = _binary_chunk(path)
    for name in _names(data, "extensionsRequired"):
        if name not in UNDERSTOOD and not name.startswith(LOOKS):
            raise GltfError(f"it requires the extension {name}, which is not supported")
    for name in _names(data, "extensionsUsed"):
        if name not in UNDERSTOOD:
            document.note(f"extension {name} ignored")
    return document


def whole(row: dict[str, Any], key: str, default: int | None = None) -> int:
    """A whole number of at least 0.

    Raises:
        GltfError: it is missing or something else.
    """
    value = row.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise GltfError(f"'{key}' is {str(value)[:40]}, needed a whole number")
    return value


def _extensions(row: dict[str, Any]) -> dict[str, Any]:
    found = row.get("extensions", {})
    return found if isinstance(found, dict) else {}


def _names(data: dict[str, Any], key: str) -> list[str]:
    found = data.get(key, [])
    return [str(name)[:60] for name in found] if isinstance(found, list) else []


def _binary_chunk(path: Path) -> bytes | None:
    """The chunk behind the JSON of a GLB file; None: it has none."""
    with open_regular(path, FILE_BYTES_MAX) as file:
        content = file.read()
    (length,) = struct.unpack("<I", content[12:16])
    place = 20 + length
    if len(content) < place + 8:
        return None
    size, kind = struct.unpack("<II", content[place : place + 8])
    if kind != _CHUNK_BIN:
        return None
    if place + 8 + size > len(content):
        raise GltfError("it is cut off in its binary chunk")
    return content[place + 8 : place + 8 + size]
