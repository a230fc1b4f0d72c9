"""What a search has proposed, beside its campaign file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from schemas.files.proposals import FILE_NAME, beside, encode_proposed, with_proposals
from schemas.files.yaml_file import YamlError
from schemas.sections.search import Rows, rows_of, text_of

ROWS: list[Rows] = [[[1.5, True, "a"], [2.0, False, "ü\n"]], '[[3,4.5e-7,"b"]]']
CONTENT: dict[str, Any] = {"campaign": "c", "search": {"first": [[0.5]], "proposed": ROWS}}


def _written(folder: Path, more: str = "") -> dict[str, Any]:
    data = encode_proposed(ROWS)
    (folder / FILE_NAME).write_bytes(data + more.encode())
    return beside(CONTENT, data)


def test_values_come_back(tmp_path: Path) -> None:
    named = _written(tmp_path)
    assert set(named["search"]["proposed"]) == {"generations", "sha256"}
    read = with_proposals(named, tmp_path, "campaign.yaml")["search"]["proposed"]
    assert [rows_of(rows) for rows in read] == [rows_of(rows) for rows in ROWS]
    assert [type(value) for value in rows_of(read[0])[1]] == [float, bool, str]
    assert CONTENT["search"]["proposed"] is ROWS


def test_a_file_that_has_grown_since_still_fits(tmp_path: Path) -> None:
    named = _written(tmp_path, '[[5,6,"c"]]\n[[7')
    assert len(with_proposals(named, tmp_path, "x")["search"]["proposed"]) == 2


def test_anything_else_stays_as_it_is(tmp_path: Path) -> None:
    for content in (None, [], {"search": []}, CONTENT):
        assert with_proposals(content, tmp_path, "x") is content


def test_what_does_not_fit_is_told_in_one_line(tmp_path: Path) -> None:
    named = _written(tmp_path)
    for damaged, said in (
        (b"", "is not what f.yaml names; copy both from one run"),
        (encode_proposed(ROWS[:1]), "is not what f.yaml names; copy both from one run"),
        (encode_proposed(ROWS).replace(b"1.5", b"1.6"), "is not what f.yaml names"),
        (None, "No such file or directory; it belongs to f.yaml"),
    ):
        path = tmp_path / FILE_NAME
        path.unlink() if damaged is None else path.write_bytes(damaged)
        with pytest.raises(YamlError, match=said) as caught:
            with_proposals(named, tmp_path, "f.yaml")
        assert "\n" not in str(caught.value)
    named["search"]["proposed"] = {"file": "/etc/passwd"}
    with pytest.raises(YamlError, match=r"f.yaml: search.proposed.*unknown key"):
        with_proposals(named, tmp_path, "f.yaml")


def test_text_that_is_no_rows_is_told() -> None:
    assert text_of([[1.0, 2]]) == "[[1.0,2]]"
    with pytest.raises(ValueError, match="no rows of values"):
        rows_of('{"a": 1}')
