"""The site as plain files: ``make site``, or ``python docs/site/build.py --out build/site``.

The pages are laid out in a folder of their own as they lie in the repository, so that their links
stay as they are; what is generated from the code is written beside them, and sources that pages
link become pages. Then Sphinx builds it; a warning is an error, a link that leads nowhere too.
"""

from __future__ import annotations

import argparse
import re
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
SITE = Path(__file__).parent
PAGES = ("README.md", "ARCHITECTURE.md", "CHANGELOG.md", "docs")
"""What is laid out, by its place in the repository."""
LINKED = re.compile(r"\]\(((?:\.\./)+|(?!\w+:|#))([\w./-]+)(#[\w-]+)?\)")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".cfg": "ini", ".ts": "typescript"}
RECORDS = "\n```{toctree}\n:hidden:\n:glob:\n\n0*\n```\n"
"""Behind the list of decision records, which stands in the page by hand."""
FRONT = '<!doctype html><meta charset="utf-8"><title>drivetwin</title>\n'
FRONT += '<meta http-equiv="refresh" content="0; url=docs/index.html">\n'
FRONT += '<p><a href="docs/index.html">drivetwin</a></p>\n'


def lay_out(stage: Path) -> None:
    """Copy the pages to ``stage``, with sources they link and all that is generated."""
    for name in PAGES:
        if (ROOT / name).is_dir():
            kept_out = shutil.ignore_patterns("site", "__pycache__")
            shutil.copytree(ROOT / name, stage / name, ignore=kept_out)
        else:
            shutil.copy(ROOT / name, stage / name)
    reference = runpy.run_path(str(SITE / "reference.py"))
    reference["write"](stage / "docs" / "reference")
    terms = runpy.run_path(str(SITE / "terms.py"))
    terms["write"](stage / "docs")
    records = stage / "docs" / "decisions" / "README.md"
    records.write_text(records.read_text() + RECORDS)
    index = stage / "docs" / "index.md"
    index.write_text(index.read_text() + _further(stage / "docs"))
    for page in sorted(stage.rglob("*.md")):
        if "reference" not in page.parts:
            page.write_text(_with_source_pages(page, stage))


def _further(docs: Path) -> str:
    """The pages that stand in no list of the index, as a list of their own."""
    listed = {line.strip() for line in (docs / "index.md").read_text().splitlines()}
    names = [page.stem for page in sorted(docs.glob("*.md"))]
    left = [name for name in names if name not in listed and name != "index"]
    entries = "".join(f"{name}\n" for name in left)
    head = "\n```{toctree}\n:hidden:\n:caption: Further pages\n\n"
    return f"{head}{entries}```\n" if left else ""


def _with_source_pages(page: Path, stage: Path) -> str:
    """The text of ``page``, whose links to files of the repository lead to pages that show them."""

    def led(found: re.Match[str]) -> str:
        target = (page.parent / (found[1] + found[2])).resolve()
        if target.exists() and target.is_file():
            return found[0]
        place = target.relative_to(stage.resolve()) if target.is_relative_to(stage) else None
        if place is None or not (ROOT / place).exists():
            return found[0]  # Sphinx says so
        made = _source_page(place, stage)
        up = "../" * len(page.parent.relative_to(stage).parts)
        return f"]({up}{made})"

    return LINKED.sub(led, page.read_text())


def _source_page(place: Path, stage: Path) -> Path:
    """A page that shows the file, or lists the folder, at ``place`` of the repository."""
    source, made = ROOT / place, Path("source") / f"{place}.md"
    target = stage / made
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        title = f"---\norphan: true\n---\n\n# {place.as_posix()}\n\n"
        if source.is_dir():
            names = sorted(path.name for path in source.iterdir() if path.name[0] not in "._")
            text = "This folder of the repository holds:\n\n" + "".join(
                f"- `{name}`\n" for name in names
            )
        else:
            language = LANGUAGES.get(source.suffix, "text")
            text = f"~~~~~~{language}\n{source.read_text()}~~~~~~\n"
        target.write_text(title + text)
    return made


def render(stage: Path, out: Path) -> int:
    """Build the pages at ``stage`` into ``out``; the exit code of Sphinx, 1 after a warning."""
    from sphinx.cmd.build import build_main

    words = ["-b", "html", "-W", "--keep-going", "-q", "-c", str(SITE)]
    return build_main([*words, "-d", f"{stage}.doctrees", str(stage), str(out)])


def build(out: Path) -> int:
    """Build the site into ``out``; the exit code of Sphinx."""
    with tempfile.TemporaryDirectory(prefix="site-") as folder:
        stage = Path(folder).resolve() / "pages"
        stage.mkdir()
        lay_out(stage)
        code = render(stage, out)
    if code == 0:
        (out / "index.html").write_text(FRONT)
        for left in (".buildinfo", "objects.inv"):
            (out / left).unlink(missing_ok=True)
    return code


def main() -> int:
    """Build the site and say where it is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site")
    out = parser.parse_args().out.resolve()
    ours = (out / "searchindex.js").exists()
    if out.exists() and not ours and (out.is_file() or any(out.iterdir())):
        print(f"{out} is not a built site; give --out a new folder", file=sys.stderr)
        return 2
    shutil.rmtree(out, ignore_errors=True)
    if code := build(out):
        print("the site was not built; mend what the lines above name", file=sys.stderr)
        return code
    print(f"read {out / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
