"""Documents name what exists: files, modules, names in them, links; diagrams are as drawn."""

from __future__ import annotations

import ast
import re
import runpy
from functools import lru_cache
from pathlib import Path

import pytest

from schemas.wire.topics import TOPICS

ROOT = Path(__file__).parents[2]
PACKAGES = ("conductor", "devkit", "hpc", "schemas", "twin", "viewer")
TOP = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md")
PAGES = [
    *(ROOT / name for name in TOP),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
]
RECORDS = sorted((ROOT / "docs" / "decisions").glob("*.md"))
"""Dated: their links are checked, the paths in their prose are those of their day."""

FILE = re.compile(
    rf"(?<![\w.-])(?<!\w/)(?:(?:{'|'.join(PACKAGES)}|tests|docs)/(?:[\w-]+/)*[\w-]+\.py)\b"
)
FOLDER = re.compile(rf"`((?:{'|'.join(PACKAGES)}|tests|docs)(?:/[a-z_]+)+)/?`")
DOTTED = re.compile(rf"`((?:{'|'.join(PACKAGES)})(?:\.\w+)+)(?:\(\))?`")
IMPORT = re.compile(rf"^(?:from|import) ((?:{'|'.join(PACKAGES)})(?:\.\w+)*)", re.MULTILINE)
NO_MODULES = ("conductor.owner", ".db", ".json", ".key", ".yaml", ".service", ".sif", ".whl")
"""Ends of files that begin like a module, ``conductor.db``."""

HEADINGS = {"Context", "Decision", "Measurement", "Consequence"}

LINK = re.compile(r"\]\(([^()\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)


@lru_cache
def names_in(module: Path) -> frozenset[str]:
    """What a module or package defines or imports at its top, and attributes of its classes."""
    names: set[str] = set()
    for node in ast.parse(module.read_text()).body:
        names |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        names |= {a.asname or a.name for a in getattr(node, "names", [])}
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
            names |= {n.name for n in ast.walk(node) if isinstance(n, ast.FunctionDef)}
    return frozenset(names)


def exists(dotted: str) -> bool:
    """Whether ``dotted`` is a package, a module, or a name in one."""
    place, parts = ROOT, dotted.split(".")
    while parts and (place / parts[0]).is_dir():
        place /= parts.pop(0)
    if parts and (place / f"{parts[0]}.py").is_file():
        module = place / f"{parts.pop(0)}.py"
    else:
        module = place / "__init__.py"
    return module.is_file() and set(parts) <= names_in(module)


def named(page: Path) -> set[str]:
    """Files, folders and modules that ``page`` names."""
    text = page.read_text()
    dotted = {d for d in DOTTED.findall(text) if not d.endswith(NO_MODULES)}
    folders = {f for f in FOLDER.findall(text) if not any(t.key.startswith(f) for t in TOPICS)}
    return {*FILE.findall(text), *folders, *dotted, *IMPORT.findall(text)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_names_is_there(page):
    gone = [
        name
        for name in sorted(named(page))
        if not ((ROOT / name).exists() if "/" in name else exists(name))
    ]
    assert not gone, f"{page.name} names what is not there; mend the page"


def test_names_are_looked_for():
    assert len(named(ROOT / "ARCHITECTURE.md")) > 30
    assert exists("schemas.messages.Tick")
    assert exists("conductor.core")
    assert not exists("conductor.core.nothing")
    assert not exists("schemas.messages.Nothing")


def test_a_link_is_called_like_its_module():
    wrong = [
        f"{page.name}: {label} -> {target}"
        for page in PAGES
        for label, target in re.findall(r"\[`([\w/]+\.py)`\]\(([^)#]+)", page.read_text())
        if Path(label).name != Path(target).name
    ]
    assert not wrong


def test_the_architecture_stays_short():
    words = len((ROOT / "ARCHITECTURE.md").read_text().split())
    assert words <= 2500, "what was tried and measured belongs in docs/decisions"


def test_the_readme_is_a_page_with_a_film():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150
    assert (ROOT / "docs" / "images" / "scenarios.webp").stat().st_size < 1_000_000


def anchors(page: Path) -> set[str]:
    """What headings of ``page`` are linked by, as GitHub makes it."""
    headings = re.findall(r"^#+ (.*)", FENCE.sub("", page.read_text()), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", [*PAGES, *RECORDS], ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    astray = []
    for link in LINK.findall(FENCE.sub("", page.read_text())):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            astray.append(link)
    assert not astray, f"links of {page.name} that lead nowhere"


def test_every_page_is_reached_from_the_readme():
    reached, left = set(), [ROOT / "README.md"]
    while left:
        page = left.pop()
        reached.add(page)
        links = {link.partition("#")[0] for link in LINK.findall(page.read_text())}
        targets = {(page.parent / link).resolve() for link in links if link.endswith(".md")}
        left += [target for target in targets - reached if target.exists()]
    assert set(PAGES) <= reached


@pytest.mark.parametrize("page", [*PAGES, *RECORDS], ids=lambda page: page.stem)
def test_commands_stand_in_blocks_that_are_checked(page):
    """Only ```sh blocks are read by tests/unit/conductor/test_documented_commands.py."""
    text = re.sub(r"^```sh\n.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    assert not re.findall(
        r"^ *(?:conductor|devkit|hpc|twin|viewer) [a-z]+ .*--", text, re.MULTILINE
    )


def test_decision_records_are_listed_and_numbered():
    index = (ROOT / "docs" / "decisions" / "README.md").read_text()
    records = [page for page in RECORDS if page.name != "README.md"]
    assert [page.name[:4] for page in records] == [f"{n:04}" for n in range(1, len(records) + 1)]
    for page in records:
        text = page.read_text()
        assert f"]({page.name})" in index
        assert re.search(r"^20\d\d-\d\d-\d\d", text, re.MULTILINE), f"{page.name} has no date"
        for heading in HEADINGS:
            assert f"\n## {heading}\n" in text, f"{page.name} has no '{heading}'"


def test_diagrams_are_as_drawn():
    script = ROOT / "docs" / "diagrams" / "draw.py"
    for name, draw in runpy.run_path(str(script))["DIAGRAMS"].items():
        drawn = (ROOT / "docs" / "images" / name).read_text()
        assert drawn == draw(), f"{name} is old: python docs/diagrams/draw.py"
