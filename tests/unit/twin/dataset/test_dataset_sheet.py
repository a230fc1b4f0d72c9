"""Sheets of a dataset that cannot be written: refused before anything is rendered."""

from __future__ import annotations

import pytest

from twin.base.errors import UsageError
from twin.dataset import command, sheet
from twin.dataset.command import DatasetRequest, run_dataset


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("sheet.gif", r"preview .*sheet\.gif: give a file that ends in \.png or \.jpg"),
        ("data/sheet.gif", "give a file that ends in"),
        ("absent/sheet.png", "no folder .*absent; make it, or give another one"),
        ("taken.png", "is a folder; give a file"),
    ],
)
def test_it_is_refused_before_anything_is_made(tmp_path, monkeypatch, name, said):
    monkeypatch.setattr(command, "make_dataset", lambda *_, **__: pytest.fail("rendered"))
    (tmp_path / "taken.png").mkdir()
    request = DatasetRequest(
        out=tmp_path / "data", plain={"count": 1}, preview=tmp_path / name, slots=1
    )
    with pytest.raises(UsageError, match=said) as error:
        run_dataset(request)
    assert "\n" not in str(error.value)
    assert not request.out.exists()


def test_it_may_lie_in_the_folder_that_is_yet_to_be_made(tmp_path):
    """However that folder is spelled, but in no other one that is not there."""
    path = tmp_path / "data" / "sheet.JPG"
    assert sheet.check_sheet(path, tmp_path / "x" / ".." / "data") is None
    with pytest.raises(UsageError, match="no folder"):
        sheet.check_sheet(path, tmp_path / "date")
