"""Unit tests lie in folders named as the packages that they test."""

from pathlib import Path

TESTS = Path(__file__).parents[1]


def test_folders_of_unit_tests_are_packages():
    unit = TESTS / "unit"
    folders = {path.parent.relative_to(unit) for path in unit.rglob("*.py")}
    assert len(folders) > 40
    strange = [str(each) for each in sorted(folders) if not (TESTS.parent / each).is_dir()]
    assert not strange, f"tests/unit has folders without a package: {strange}"


def test_no_file_of_tests_lies_outside_a_package():
    assert [path.name for path in (TESTS / "unit").glob("*.py")] == []
