"""Files that are complete or absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from twin.base.files import sync_files, write_atomic


def test_a_file_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_atomic(path, b"one, and rather long")
    write_atomic(path, b"two", sync=False)
    sync_files(tmp_path)
    assert path.read_bytes() == b"two"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_write_that_fails_leaves_what_was_there_and_nothing_beside_it(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_atomic(tmp_path / "taken", b"x")
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


def test_a_file_is_private_from_its_first_byte_on(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        write_atomic(tmp_path / "key", b"x", mode=0o600)
        write_atomic(tmp_path / "plain", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "key").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "plain").stat().st_mode & 0o777 == 0o644


def test_a_file_and_its_folder_are_synced_before_it_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bytes before the name, the name before the return."""
    synced: list[str] = []
    fsync = os.fsync

    def noting(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noting)
    write_atomic(tmp_path / "a", b"x")
    temporary, folder = synced
    assert temporary.startswith(".a.")
    assert folder == tmp_path.name
    write_atomic(tmp_path / "b", b"x", sync=False)
    assert len(synced) == 2
