"""The code of docs/gym.md runs, and says what stands beside it."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[4] / "docs" / "gym.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_a_block_of_the_page_runs(number, capsys):
    block = BLOCKS[number]
    exec(compile(block, f"docs/gym.md, block {number}", "exec"), {})
    printed = capsys.readouterr().out
    for said in re.findall(r"print\(.*\) +# (.*)", block):
        assert said in printed


def test_there_are_blocks():
    assert len(BLOCKS) == 3
    assert "# ['1200-clear' '1200-light_rain']" in PAGE
