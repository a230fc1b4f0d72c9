"""What somebody named as a file: devices, pipes, sockets, folders and giants are not read."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from schemas.files.regular_file import open_regular, read_regular
from schemas.files.yaml_file import YamlError, load_yaml


def a_pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe")
    return folder / "pipe"


def a_socket(folder: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(folder / "socket"))
    return folder / "socket"


def a_link(folder: Path) -> Path:
    (folder / "link").symlink_to("/dev/zero")
    return folder / "link"


def a_giant(folder: Path) -> Path:
    with (folder / "giant").open("wb") as file:
        file.truncate(1 << 42)
    return folder / "giant"


NOT_READ: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a device without end": (lambda folder: Path("/dev/zero"), "a device; a regular file"),
    "the terminal": (lambda folder: Path("/dev/tty"), "a device; a regular file"),
    "a pipe": (a_pipe, "a named pipe; a regular file"),
    "a socket": (a_socket, "a socket; a regular file"),
    "a link to a device": (a_link, "a device; a regular file"),
    "a folder": (lambda folder: folder, "Is a directory"),
    "a giant": (a_giant, f"{1 << 42} bytes, at most"),
    "nothing": (lambda folder: folder / "none", "No such file"),
}
each = pytest.mark.parametrize(("make", "words"), NOT_READ.values(), ids=NOT_READ)


@each
def test_is_refused_before_it_is_read(
    tmp_path: Path, make: Callable[[Path], Path], words: str
) -> None:
    with pytest.raises(OSError, match=words):
        read_regular(make(tmp_path), 100)


@each
def test_is_one_line_where_yaml_is_expected(
    tmp_path: Path, make: Callable[[Path], Path], words: str
) -> None:
    path = make(tmp_path)
    with pytest.raises(YamlError, match=words) as caught:
        load_yaml(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_file_of_the_largest_size_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_regular(path, 5) == b"12345"
    with pytest.raises(OSError, match="5 bytes, at most 4 are read"):
        read_regular(path, 4)
    with open_regular(path) as file:
        assert file.read() == b"12345"


def test_a_file_that_tells_no_size_is_read_up_to_the_limit() -> None:
    assert Path("/proc/self/maps").stat().st_size == 0
    with pytest.raises(OSError, match="more than 100 bytes"):
        read_regular(Path("/proc/self/maps"), 100)


def test_a_pipe_that_takes_the_place_of_a_file_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at its type and its opening."""
    path = tmp_path / "a"
    path.write_bytes(b"x")
    opened = os.open

    def late(name: Path, flags: int) -> int:
        path.unlink()
        os.mkfifo(path)
        return opened(name, flags)

    monkeypatch.setattr(os, "open", late)
    with pytest.raises(OSError, match="a named pipe"):
        read_regular(path, 5)


def test_no_descriptor_is_left(tmp_path: Path) -> None:
    """Of these files; others of this process come and go by themselves."""
    before = {path: descriptors_of(path) for path in (Path("/dev/zero"), Path("/dev/tty"))}
    for make, _ in NOT_READ.values():
        with pytest.raises(OSError):
            read_regular(make(tmp_path), 100)
    assert {path: descriptors_of(path) for path in before} == before
    assert descriptors_of(tmp_path) == []
    with (tmp_path / "giant").open():
        assert descriptors_of(tmp_path) == [str(tmp_path / "giant")], "so this test can fail"


def descriptors_of(path: Path) -> list[str]:
    """What this process has open of ``path`` and what is in it."""
    found = []
    for link in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # closed meanwhile
            found.append(str(link.readlink()))
    return sorted(name for name in found if name == str(path) or name.startswith(f"{path}/"))
