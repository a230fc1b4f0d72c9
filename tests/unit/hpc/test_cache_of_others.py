"""A cache in which others may write is not trusted: what lies there would be run as its user."""

import os
import subprocess
from pathlib import Path

import pytest

from hpc.inputs import NamedRepository, fetch_image, fetch_repository
from twin.base.cache import check_cache, is_trusted
from twin.base.errors import UsageError
from twin.stack_identity import content


@pytest.fixture
def repository(tmp_path: Path) -> NamedRepository:
    """A repository with one commit."""
    folder = tmp_path / "origin"
    folder.mkdir()
    (folder / "drive.py").write_text("print()\n")
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "--quiet", "-b", "main"], ["add", "."], [*who, "commit", "-qm", "x"]):
        subprocess.run(["git", "-C", str(folder), *words], check=True)
    return NamedRepository(str(folder), "main")


@pytest.mark.parametrize("name", ["", "repositories", "mirrors"])
def test_a_cache_that_others_may_write_is_refused(
    tmp_path: Path, repository: NamedRepository, name: str
) -> None:
    cache = tmp_path / "cache"
    fetch_repository(repository, cache)
    (cache / name).chmod(0o777)
    with pytest.raises(UsageError, match=r"others may write to it \(mode 0777\)") as caught:
        fetch_repository(repository, cache)
    assert "\n" not in str(caught.value)
    assert not is_trusted(cache)


def test_a_cache_of_another_user_is_refused(
    tmp_path: Path, repository: NamedRepository, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "cache"
    fetch_repository(repository, cache)
    somebody = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: somebody)
    with pytest.raises(UsageError, match=f"you are {somebody}: what lies there would be run"):
        fetch_repository(repository, cache)
    (tmp_path / "image.sif").write_bytes(b"sif")
    with pytest.raises(UsageError, match="belongs to user id"):
        fetch_image(str(tmp_path / "image.sif"), cache)


def test_a_cache_below_a_folder_of_everybody_is_refused(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    with pytest.raises(UsageError, match="everybody may write to"):
        check_cache(shared / "cache")
    shared.chmod(0o1777)  # as /tmp is
    assert is_trusted(shared / "cache")


def test_a_link_into_a_folder_that_others_may_write_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o775)
    (tmp_path / "cache").symlink_to(tmp_path / "open")
    assert not is_trusted(tmp_path / "cache")


def test_what_is_made_is_ones_own_whatever_the_mask(
    tmp_path: Path, repository: NamedRepository
) -> None:
    before = os.umask(0o002)
    try:
        found = fetch_repository(repository, tmp_path / "new" / "cache")
    finally:
        os.umask(before)
    assert (found.folder / "drive.py").exists()
    assert is_trusted(tmp_path / "new" / "cache")


def test_notes_about_contents_in_such_a_cache_are_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TWIN_CACHE", str(tmp_path / "cache"))
    tree = tmp_path / "tree"
    tree.mkdir()
    (tree / "a").write_text("a")
    true = content.tree_digest(tree)
    (note,) = (tmp_path / "cache/contents").iterdir()
    note.write_text(note.read_text().replace(true, "0" * 64))
    assert content.tree_digest(tree) == "0" * 64
    (tmp_path / "cache/contents").chmod(0o777)
    assert content.tree_digest(tree) == true
