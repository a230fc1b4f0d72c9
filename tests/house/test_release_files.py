"""Files that a release depends on agree with pyproject.toml."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from release import licences, worker
from release.environment import closure

from schemas.files.software import OPENCV, OPENCV_USUAL

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_citation_names_this_version_and_its_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] == "software"
    assert {"message", "title", "authors", "abstract"} <= set(citation)
    assert all(author for author in citation["authors"])
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\d", citation["date-released"])


def test_the_workers_distribution_is_derived_from_ours():
    derived = tomllib.loads(worker.pyproject(ROOT))
    theirs = derived["project"]
    assert theirs["version"] == PROJECT["version"]
    assert set(PROJECT["dependencies"]) - set(theirs["dependencies"]) == {
        line for line in PROJECT["dependencies"] if line.partition("~=")[0] in worker.WITHOUT
    } | {line for extra in worker.OPTIONAL for line in theirs["optional-dependencies"][extra]}
    assert theirs["optional-dependencies"]["networks"][0].startswith("opencv-python-headless~=")
    assert theirs["scripts"].items() <= PROJECT["scripts"].items()
    packages = derived["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert set(packages) < set(ours["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])


def test_the_usual_opencv_is_the_one_that_is_locked():
    assert f"{OPENCV}=={OPENCV_USUAL}" in (ROOT / "constraints.txt").read_text().split()


def test_a_library_that_gets_another_name_is_noticed(tmp_path):
    text = (ROOT / "pyproject.toml").read_text().replace('"plotly~', '"plotly2~')
    (tmp_path / "pyproject.toml").write_text(text)
    with pytest.raises(AssertionError, match="another name"):
        worker.pyproject(tmp_path)


def test_what_requirements_lead_to():
    assert {"numpy", "warp-lang"} <= set(closure(["warp-lang"]))
    assert closure(["numpy; extra == 'none'"]) == []
    assert closure(["numpy; extra == 'some'"], ["some"]) == ["numpy"]
    with pytest.raises(SystemExit, match="not installed here"):
        closure(["no-such-distribution"])


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT", True),
        ("Apache-2.0 OR GPL-3.0-only", True),
        ("(MIT AND Zlib)", True),
        ("(MIT OR GPL-3.0-only) AND Zlib", True),
        ("(MIT OR Apache-2.0) AND GPL-3.0-only", False),
        ("GPL-3.0-only AND (MIT OR Apache-2.0)", False),
        ("MIT OR (GPL-3.0-only AND Zlib)", True),
        ("MIT Zlib", False),
        ("(MIT", False),
        ("MIT AND GPL-3.0-only", False),
        ("GPL-3.0-only", False),
        ("", False),
        ("UNKNOWN", False),
    ],
)
def test_which_licences_are_allowed(expression, allowed):
    assert licences.is_allowed(expression) is allowed
