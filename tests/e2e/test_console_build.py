"""The built page is what its sources give, and brings nothing but them and Preact."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

CONSOLE = Path(__file__).parents[2] / "viewer" / "console"
PAGE, BUILT = CONSOLE / "page", CONSOLE / "built"
LICENSES = {"MIT", "ISC", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause"}


def packages() -> dict[str, dict[str, str]]:
    """Packages of the lock file by folder, without our own."""
    locked = json.loads((PAGE / "package-lock.json").read_text())["packages"]
    return {name: entry for name, entry in locked.items() if name}


def test_a_rebuild_gives_the_same_bytes(tmp_path):
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm: install Node")
    page = tmp_path / "page"
    shutil.copytree(PAGE, page, ignore=shutil.ignore_patterns("node_modules"))
    done = subprocess.run(
        [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"],
        cwd=page,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    if done.returncode != 0:
        pytest.skip(f"npm installs nothing here: {done.stderr.strip().splitlines()[-1:]}")
    for script in ("types", "build"):
        subprocess.run([npm, "run", script], cwd=page, check=True, capture_output=True, timeout=600)
    made = tmp_path / "built"
    names = sorted(path.name for path in BUILT.iterdir())
    assert names == sorted(path.name for path in made.iterdir())
    for name in names:
        same = (made / name).read_bytes() == (BUILT / name).read_bytes()
        assert same, f"{name} is not what its sources give: run `make console`"


def test_packages_are_exact_and_their_licences_are_on_the_list():
    wanted = json.loads((PAGE / "package.json").read_text())
    versions = {**wanted["dependencies"], **wanted["devDependencies"]}
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions.values())
    assert set(wanted["dependencies"]) == {"preact"}  # what the built page contains
    assert {entry["license"] for entry in packages().values()} <= LICENSES


def test_the_lock_file_names_no_registry_and_keeps_checksums():
    assert all("resolved" not in entry for entry in packages().values())
    assert all(entry["integrity"].startswith("sha512-") for entry in packages().values())


def test_no_data_become_markup_or_code():
    """Texts of stacks, cases and files are shown by Preact, which makes them text."""
    sources = [*(PAGE / "src").iterdir()]
    assert len(sources) > 20
    ways = re.compile(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|https?://"
    )
    found = [(path.name, ways.findall(path.read_text())) for path in sources]
    assert [(name, what) for name, what in found if what] == []


def test_the_policy_of_the_page_admits_no_script_of_others():
    page = (BUILT / "index.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy
    parts = dict(part.strip().split(" ", 1) for part in policy[1].split(";"))
    assert parts["default-src"] == "'none'"
    assert parts["script-src"] == parts["connect-src"] == "'self'"
    assert re.findall(r"<script[^>]*>", page) == ['<script src="console.js" defer>']
    assert "style=" not in page


def test_the_licence_of_what_is_built_in_stands_in_it():
    assert "Jason Miller" in (BUILT / "console.js").read_text()
