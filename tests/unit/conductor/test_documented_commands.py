"""Every command line of the documentation has options and arguments that the command takes."""

from __future__ import annotations

import importlib
import re
import shlex

import pytest
from page_blocks import PAGES, blocks
from typer.main import get_command

PROGRAMS = ("conductor", "devkit", "drivetwin", "hpc", "twin", "viewer")
STARTS = re.compile(rf"^(?:\$ )?(?:{'|'.join(PROGRAMS)}) [a-z]")


def documented():
    """Command lines in code blocks, and those of tables of README and how-to, with their page."""
    for page in PAGES:
        shown = [block for block in blocks(page) if block.language == "sh" and block.checked]
        lines = [line for block in shown for line in block.text.replace("\\\n", " ").splitlines()]
        if page.name in ("README.md", "how-to.md"):
            rows = [row for row in page.read_text().splitlines() if row.startswith("| ")]
            spans = [span for row in rows for span in re.findall(r"`([^`]+)`", row)]
            lines += [span for span in spans if not span.split()[-1].startswith("--")]
        for line in map(str.strip, lines):
            if STARTS.match(line):
                yield pytest.param(line, id=f"{page.stem} {line}".replace("/", "-"))


def words_of(line: str) -> list[str]:
    """Its words up to a comment, a pipe, a redirection or the next command."""
    words = []
    for word in shlex.split(line.removeprefix("$ "), comments=True):
        if word in ("&&", "||", "|", "&", ">", ">>") or word.startswith((">", "2>")):
            break
        words.append(word)
        if word.endswith(";"):
            words[-1] = word[:-1]
            break
    return [word for word in words if word != "--insecure"]


def commands_of(command):
    """The commands of a group; none of one that is no group."""
    return getattr(command, "commands", {})


@pytest.mark.parametrize("line", list(documented()))
def test_a_documented_command_line_can_be_typed(line):
    program, *words = words_of(line)
    command = get_command(importlib.import_module(f"{program}.cli").app)
    assert commands_of(command)
    while commands_of(command) and words:
        name, *words = words
        assert name in commands_of(command), f"{program} has no command '{name}'"
        command = commands_of(command)[name]
    if words:  # otherwise it is only named
        command.make_context(command.name, words)
