"""The site is built without a warning, reads as plain files, and its search works from disk."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest
from browser_pages import PATIENCE_MS, chromium
from page_blocks import ROOT, RUN
from playwright import sync_api

BUILD = ROOT / "docs" / "site" / "build.py"
OUTSIDE = re.compile(r"""(?:src|srcset)=["'](?:https?:)?//|url\(["']?(?:https?:)?//|@import""")
STYLE = re.compile(r"""<link[^>]*href=["'](?:https?:)?//""")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site."""
    out = tmp_path_factory.mktemp("site") / "site"
    done = subprocess.run(
        [sys.executable, str(BUILD), "--out", str(out)], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return out


class Links(HTMLParser):
    """Targets of links of a page, and what may be linked on it."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text())

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors |= {given[name] for name in ("id", "name") if given.get(name)}
        self.links += [given[name] for name in ("href", "src") if given.get(name)]


@cache
def links_of(page: Path) -> Links:
    return Links(page)


def test_every_link_and_anchor_is_there(site):
    astray, looked = [], 0
    for page in sorted(site.rglob("*.html")):
        for link in links_of(page).links:
            if re.match(r"[a-z]+:", link):
                continue
            looked += 1
            path, _, anchor = link.partition("#")
            target = (page.parent / path.partition("?")[0]).resolve() if path else page
            known = target.suffix != ".html" or not anchor or not target.exists()
            if not target.exists() or not (known or anchor in links_of(target).anchors):
                astray.append(f"{page.name}: {link}")
    assert not astray[:20]
    assert looked > 1000


def test_no_page_asks_another_machine(site):
    for path in sorted(p for p in site.rglob("*") if p.suffix in (".html", ".css")):
        text = path.read_text()
        assert not OUTSIDE.search(text), path
        assert not STYLE.search(text), path


def test_all_sections_and_generated_pages_are_there(site):
    names = ["fields", "kpis", "sensors", "topics", "exit-codes", "commands", "python"]
    names += [f"command-{program}" for program in ("twin", "conductor", "devkit", "viewer", "hpc")]
    for name in names:
        assert (site / "docs" / "reference" / f"{name}.html").exists(), name
    assert "scenario.ego_start_m" in (site / "docs/reference/fields.html").read_text()
    assert "dtc_min_m" in (site / "docs/reference/kpis.html").read_text()
    assert "--history" in (site / "docs/reference/command-conductor.html").read_text()
    assert "observation" in (site / "docs/reference/python.html").read_text()
    assert "url=docs/index.html" in (site / "index.html").read_text()


def test_tutorials_link_the_glossary(site):
    for page in RUN:
        made = site / page.relative_to(ROOT).with_suffix(".html")
        linked = [link for link in links_of(made).links if "glossary.html#term-" in link]
        assert linked, page.name
        assert len(linked) == len(set(linked)), f"{page.name} links a term twice"


def test_search_works_from_disk(site):
    asked: list[str] = []
    with chromium(sync_api) as browser:
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"file://{site}/search.html?q=fingerprint")
        # Results come one after the other.
        found = page.locator("#search-results ul.search li a[href*=determinism]").first
        found.wait_for(timeout=PATIENCE_MS)
    assert asked
    assert not [url for url in asked if not url.startswith("file:")]


@pytest.mark.parametrize("link", ["[a](nowhere.md)", "[a](other.md#nothing)"])
def test_a_link_that_leads_nowhere_stops_the_build(tmp_path, link):
    pages = tmp_path / "pages"
    (pages / "docs").mkdir(parents=True)
    (pages / "docs" / "index.md").write_text(f"# Title\n\n{link}\n\n```{{toctree}}\nother\n```\n")
    (pages / "docs" / "other.md").write_text("# Other\n")
    code = "import runpy, sys; from pathlib import Path; "
    code += "sys.exit(runpy.run_path(sys.argv[1])['render'](*map(Path, sys.argv[2:])))"
    words = [sys.executable, "-c", code, str(BUILD), str(pages), str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert "other" in done.stderr or "nowhere" in done.stderr


@pytest.mark.parametrize("place", [".", "kept.txt"])
def test_something_else_is_left_alone(tmp_path, place):
    (tmp_path / "kept.txt").write_text("mine")
    words = [sys.executable, str(BUILD), "--out", str(tmp_path / place)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "kept.txt").read_text() == "mine"
