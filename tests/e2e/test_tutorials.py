"""Start and the tutorials do what they say: their files are written and their commands are typed,
from top to bottom, in an empty folder. ``tests/page_blocks.py`` says how a page marks what is not.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from page_blocks import ROOT, RUN, Block, blocks

RUN_BLOCKS_MIN = 20


def commands_of(block: Block) -> list[str]:
    """The command lines of a block."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_a_page_does_what_it_says(page, marked, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("DRIVETWIN", str(ROOT))
    for block in blocks(page):
        if block.file:
            (tmp_path / block.file).write_text(block.text)
        if block.language != "sh" or not block.run:
            continue
        commands = commands_of(block)
        for command in commands:
            expected = block.ends_with if command == commands[-1] else 0
            child = marked.start(prefix=("bash", "-o", "pipefail", "-c", command), folder=tmp_path)
            out, err = child.communicate()
            said = f"{page.name}:{block.line}: {command}\n{out[-1000:]}\n{err[-3000:]}"
            assert child.returncode == expected, said


def test_pages_are_run_and_files_are_named():
    every = [block for page in RUN for block in blocks(page)]
    assert len([b for b in every if b.language == "sh" and b.run]) >= RUN_BLOCKS_MIN
    files = [b for b in every if b.language in ("yaml", "python") and b.checked]
    assert all(b.file for b in files), [b.name for b in files if not b.file]
