"""The script that reads the prose finds what is beside the rules, and nothing else."""

import pytest
from prose import docstrings, of_module, of_page, plain, pointing_back, shipped, vocabulary

STOOD = [
    "so that nobody is for another's fault",
    "Who has no certificate of the fabric gets no byte of it",
    "What strangers wrote stands on one line, control characters written out",
    "the hand is no part of the seed",
    "Of lidars, by message.",
    "`--out FILE` is bad input (2), no lost infrastructure (3)",
]
"""Sentences as they once stood."""
WRITTEN = """A case is never charged for a crash that another case caused. Clients without a
certificate receive nothing. Untrusted text is escaped and printed on one line. Manual changes are
not reproducible, so the attempt gets no verdict. Oversized messages. LiDAR view items by message
name. `--out` naming a file now exits with 2, not 3. A run resumes where free memory was short; it
looks at 640x360 pixels."""


@pytest.mark.parametrize("sentence", STOOD)
def test_what_once_stood_is_found(sentence):
    assert list(of_page("page.md", f"# Title\n\nIt is said:\n{sentence}.\n", vocabulary()))
    source = f'def f():\n    """{sentence}."""\n'
    (found, *_) = of_module("module.py", source, vocabulary())
    assert found.place == "module.py:2"


def test_what_a_person_would_write_is_left_alone():
    assert not list(of_page("page.md", WRITTEN, [*vocabulary(), *shipped()]))


def test_a_finding_names_its_line_and_code_is_no_prose():
    text = "# Title\n\n```sh\nutilize --of it\n```\n\nPlain.\nWe utilize it, in `utilize`.\n"
    assert plain(text).count("\n") == text.count("\n")
    places = [finding.place for finding in of_page("page.md", text, vocabulary())]
    assert places == ["page.md:8"]


def test_checks_of_the_kept_linter_run():
    found = list(of_page("page.md", "It is a very unique and irregardless safe car.\n", shipped()))
    assert len(found) >= 2


def test_first_sentences_stand_alone():
    source = '"""Of these."""\n\nclass A:\n    """Width of a lane."""\n\n    def f(self):\n'
    source += '        """How wide it is."""\n'
    source += '    def g(self):\n        """Raises:\n            OSError: no file."""\n'
    assert pointing_back(source) == [1, 7, 9]
    assert [line for line, _ in docstrings(source)] == [1, 4, 7, 9]
