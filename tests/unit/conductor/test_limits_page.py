"""docs/limits.md says what the constants say."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs" / "limits.md"
ROW = re.compile(r"^\| [^|]+ \| `([\w.]+)\.(\w+)` \| ([\d,]+) \| [^|]+ \|$")


def test_every_row_names_a_constant_and_its_value() -> None:
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    rows = [line for line in rows if " constant " not in line]
    assert len(rows) > 40
    for line in rows:
        found = ROW.match(line)
        assert found, line
        module, name, value = found.groups()
        actual = getattr(importlib.import_module(module), name)
        assert f"{actual:,}" == value, f"{module}.{name} is {actual:,}, the page says {value}"
