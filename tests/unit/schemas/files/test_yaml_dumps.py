"""What is written as YAML is read as it was."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.files.yaml_file import dump_yaml, parse_yaml


@pytest.mark.parametrize(
    "text", ["196784039e57", "1234e5678901", "12", "1e5", "1_000", ".5", "no", "05:00", "true", "~"]
)
def test_text_that_looks_like_something_else_stays_text(text: str) -> None:
    """Digests of twelve hexadecimal digits look like numbers now and then."""
    data = {"parts": {"package 1.0": text}, text: [text]}
    assert parse_yaml(dump_yaml(data), "file") == data


@given(st.text("0123456789abcdef", min_size=1, max_size=12))
def test_any_digest_stays_text(digest: str) -> None:
    assert parse_yaml(dump_yaml({"digest": digest}), "file") == {"digest": digest}
