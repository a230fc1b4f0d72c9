"""Thumbnails: made once, kept beside the run within a bound, never inside it."""

import threading

import numpy as np
import pytest
from unit.viewer.console.console_runs import a_run
from waiting import PATIENCE_S

from twin.base.errors import UsageError
from viewer.console import pictures
from viewer.console.pictures import PictureCache, cache_folder, picture_from, sheet, webp


def files(folder):
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def test_a_picture_is_made_once_however_many_ask(tmp_path):
    cache, made, begun = PictureCache(tmp_path / "c"), [], threading.Barrier(4)

    def ask():
        begun.wait(PATIENCE_S)
        assert cache.get("a", lambda: made.append(1) or b"one") == b"one"

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert made == [1]
    assert PictureCache(tmp_path / "c").get("a", lambda: b"two") == b"one", "the next console too"


def test_what_was_not_asked_for_longest_goes_first(tmp_path):
    cache = PictureCache(tmp_path / "c", bytes_max=30)
    for name in ("a", "b", "c"):
        cache.get(name, lambda: b"0123456789")
    cache.get("a", lambda: pytest.fail("it is kept"))
    cache.get("d", lambda: b"0123456789")
    assert cache.size == 30
    assert len(files(tmp_path / "c")) == 3
    cache.get("a", lambda: pytest.fail("it was asked for"))
    assert cache.get("b", lambda: b"anew") == b"anew"
    assert PictureCache(tmp_path / "c", bytes_max=12).size <= 12, "a smaller one makes room"


def test_a_picture_that_cannot_be_made_is_not_kept(tmp_path):
    cache = PictureCache(tmp_path / "c")

    def refuse():
        raise UsageError("damaged")

    with pytest.raises(UsageError):
        cache.get("a", refuse)
    assert cache.get("a", lambda: b"now") == b"now"


def test_links_and_torn_files_in_the_cache_are_not_shown(tmp_path):
    folder = tmp_path / "c"
    cache = PictureCache(folder)
    cache.get("a", lambda: b"one")
    (name,) = files(folder)
    (tmp_path / "secret").write_bytes(b"SECRET")
    (folder / name).unlink()
    (folder / name).symlink_to(tmp_path / "secret")
    assert cache.get("a", lambda: b"anew") == b"anew"
    (folder / ".x.tmp").write_bytes(b"torn")
    PictureCache(folder)
    assert ".x.tmp" not in files(folder)


def test_without_a_folder_they_stay_in_memory():
    cache = PictureCache(None, memory_max=20)
    for name in ("a", "b", "c"):
        cache.get(name, lambda: b"0123456789")
    assert cache.size == 20


def test_the_cache_lies_beside_the_run(tmp_path):
    run = a_run(tmp_path / "runs" / "demo", recorded=())
    assert cache_folder(run) == tmp_path / "runs" / ".console" / "demo"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / ".console").symlink_to(tmp_path)
    assert cache_folder(tmp_path / "other" / "demo") is None, "a link leads anywhere"
    (tmp_path / "file").write_text("")
    assert cache_folder(tmp_path / "file" / "demo") is None


def test_a_sheet_has_every_case_in_its_place():
    red = np.full((90, 160, 3), (0, 0, 255), np.uint8)
    tiles = [None] * 10 + [red]
    picture = picture_from(sheet(tiles, 160, 90))
    assert picture.shape == (720, 1280, 3)
    assert picture[90 + 45, 2 * 160 + 80].tolist() == pytest.approx([0, 0, 255], abs=16)
    assert picture[45, 80].max() < 40
    tall = picture_from(sheet([np.full((180, 90, 3), 255, np.uint8)], 80, 45))
    assert tall[20, 40].min() > 200
    assert tall[20, 5].max() < 40, "its proportions are kept"


def test_what_is_no_picture_is_none():
    assert picture_from(b"") is None
    assert picture_from(b"<svg onload=alert(1)>") is None
    assert picture_from(webp(np.zeros((4, 4, 3), np.uint8))).shape == (4, 4, 3)
    assert pictures.fitted(np.zeros((10, 4000, 3), np.uint8), 80, 45).shape == (1, 80, 3)
