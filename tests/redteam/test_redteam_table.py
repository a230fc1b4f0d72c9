"""Every row of the table has its attack, and the page shows them all; `make redteam` runs them."""

from pathlib import Path

import pytest
from attacks import ATTACKS, ROWS, Attack, Found, refused_if
from redteam_table import BEGIN, END, markdown
from table import put_into

PAGE = Path(__file__).parents[2] / "docs" / "security.md"


def test_every_row_has_an_attack():
    assert {each.row for each in ATTACKS} == set(ROWS)
    assert len({each.name for each in ATTACKS}) == len(ATTACKS), "files would be mixed up"


def test_the_page_names_every_attack():
    _, _, rest = PAGE.read_text().partition(BEGIN)
    table, end, _ = rest.partition(END)
    assert end
    assert [each.what for each in ATTACKS if f"| {each.row} | {each.what} |" not in table] == []


def test_only_what_was_seen_closes_a_row():
    assert refused_if(True, "a lock", "all") == Found("refused", "a lock")
    assert refused_if(False, "a lock", "all") == Found("open", "all")


def test_the_table_of_a_page(tmp_path):
    attack = Attack(3, "picks | the lock", "a thief", "none", lambda _: Found("open", "it\nis"))
    text = markdown([(attack, attack.attempt(None))])
    assert text.splitlines()[2] == "| 3 | picks \\| the lock | a thief | none | **open** | it is |"
    page = tmp_path / "page.md"
    page.write_text(f"a\n{BEGIN}\nold\n{END}\nb\n")
    put_into(page, text, BEGIN, END)
    assert page.read_text() == f"a\n{BEGIN}\n{text}{END}\nb\n"
    with pytest.raises(SystemExit, match="no lines"):
        put_into(page, text, "<!-- none -->", END)
