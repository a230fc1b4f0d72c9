"""schemas.words: nouns and verbs go with their number."""

import re
from pathlib import Path

import pytest

from schemas.words import agree, counted, unended

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (counted(1, "case"), "1 case"),
        (counted(0, "case"), "0 cases"),
        (counted(2, "child", "children"), "2 children"),
        (agree(1, "has", "have"), "has"),
        (agree(2, "has", "have"), "have"),
        (unended(1, 1), "1 of 1 case has not ended"),
        (unended(1, 16), "1 of 16 cases has not ended"),
        (unended(3, 16), "3 of 16 cases have not ended"),
    ],
)
def test_words_go_with_their_number(words, expected):
    assert words == expected


def test_nobody_writes_plurals_by_hand():
    """``case(s)``, or an s of one's own behind a number."""
    by_hand = re.compile(r"\}s?\(s\)|[a-z]\{'s' (if|\*)|\{'' if [^}]* == 1 else 's'\}")
    packages = ("conductor", "devkit", "hpc", "schemas", "twin", "viewer")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for package in packages
        for path in sorted((ROOT / package).rglob("*.py"))
        for line in path.read_text().splitlines()
        if by_hand.search(line) and path.name != "words.py"
    ]
    assert not found
