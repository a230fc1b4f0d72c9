"""Pages about kinds show the files of ``tests/plugin_example``, word for word."""

import re
import subprocess
import sys

from plugin_site import EXAMPLE, ROOT

PAGES = {path.name: path.read_text() for path in sorted((ROOT / "docs").glob("add-a-*.md"))}
FILE = re.compile(r"^`(plugin_example/\w+\.py)`:\n\n```python\n(.*?)```$", re.DOTALL | re.MULTILINE)
POINTS = re.compile(r"^```toml\n(.*?)```$", re.DOTALL | re.MULTILINE)


def test_every_file_stands_on_one_page_as_it_is():
    shown = [found for page in PAGES.values() for found in FILE.findall(page)]
    files = {path.relative_to(EXAMPLE).as_posix() for path in EXAMPLE.rglob("*_kind.py")}
    files |= {name.replace("_kind", "") for name in files}
    assert sorted(name for name, _ in shown) == sorted(files)
    for name, text in shown:
        assert text == (EXAMPLE / name).read_text(), name


def test_pages_show_no_code_that_is_no_file():
    for name, page in PAGES.items():
        assert page.count("```python") == len(FILE.findall(page)) == 2, name


def test_the_project_file_is_what_the_pages_show_together():
    texts = [(ROOT / "docs/kinds.md").read_text(), *PAGES.values()]
    shown = [part for text in texts for part in POINTS.findall(text)]
    whole = (EXAMPLE / "pyproject.toml").read_text()
    parts = [part.strip() for block in shown for part in block.split("\n\n")]
    assert sorted(parts) == sorted(part.strip() for part in whole.split("\n\n"))


def test_the_campaign_of_the_overview_is_valid(tmp_path, monkeypatch):
    from plugin_site import install_example

    page = (ROOT / "docs/kinds.md").read_text()
    found = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    path = tmp_path / "stop-line.yaml"
    path.write_text(found[1])
    _, env = install_example(tmp_path)
    command = [sys.executable, "-m", "conductor", "validate", str(path)]
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "4 cases" in done.stdout
    command[3:] = ["fields", "scenario.line_m"]
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert "to the line" in done.stdout.replace("\n", " ")
