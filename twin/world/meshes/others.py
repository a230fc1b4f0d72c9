"""Mesh files as trimesh takes them: text in any encoding, and the files that they name."""

from __future__ import annotations

import io
from pathlib import Path

from schemas.escape import escape
from schemas.files.named_files import as_text, file_names
from schemas.files.regular_file import open_regular, read_regular
from twin.world.meshes.mesh_header import FILE_BYTES_MAX

_STL_HEAD = 80
_PLY_END = b"end_header"


def stream_of(path: Path) -> io.BytesIO:
    """The content of an OBJ, PLY or STL file, with what people wrote into it in UTF-8.

    Raises:
        OSError: it cannot be read.
    """
    with open_regular(path, FILE_BYTES_MAX) as file:
        data = file.read()
    suffix = path.suffix.lower()
    if suffix == ".ply":
        end = data.find(_PLY_END)
        return io.BytesIO(_utf8(data[:end]) + data[end:] if end >= 0 else data)
    if suffix == ".stl" and not _is_text(data):
        head = bytes(byte if byte < 128 else ord("?") for byte in data[:_STL_HEAD])
        return io.BytesIO(head + data[_STL_HEAD:])
    return io.BytesIO(_utf8(data))


def _is_text(data: bytes) -> bool:
    return data[:5].lower() == b"solid" and b"\0" not in data[:_STL_HEAD]


def _utf8(data: bytes) -> bytes:
    text = as_text(data)
    return data if len(text) == len(data) and text.isascii() else text.encode()


class Beside:
    """Files that a mesh names: beside it, or beside its material library.

    It is what trimesh calls a resolver.
    """

    def __init__(self, mesh: Path) -> None:
        self.file_name = mesh.name
        self._folders = [mesh.parent]
        self.missing: list[str] = []
        """Lines about files that are not there; the mesh is shown without them."""

    def get(self, name: str) -> bytes:
        """The content of the first file that ``name`` may mean; a material library in UTF-8.

        Raises:
            FileNotFoundError: there is none.
            OSError: it cannot be read.
        """
        for folder in self._folders:
            for each in file_names(name):
                path = folder / each
                if path.is_file():
                    return self._read(path)
        words = escape(name, 80)
        self.missing.append(f"{self.file_name}: it names {words}, which is not there; ignored")
        raise FileNotFoundError(name)

    __getitem__ = get

    def _read(self, path: Path) -> bytes:
        data = read_regular(path, FILE_BYTES_MAX)
        if path.suffix.lower() != ".mtl":
            return data
        self._folders.append(path.parent)
        return _utf8(data)
