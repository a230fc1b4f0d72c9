"""Facts of this machine, and of changed ones."""

import os
import socket
from pathlib import Path

import pytest
from foreign_distributions import install

from conductor.doctor.judging import findings
from conductor.doctor.look import (
    declared_packages,
    folder_trouble,
    installed_distributions,
    look_at_machine,
    memory_bytes,
    port_trouble,
)


def test_our_own_libraries_fit():
    packages = declared_packages()
    assert len(packages) > 15
    assert all(package.found and package.wanted for package in packages)
    assert not [package for package in packages if not package.fits]


def test_an_unknown_distribution_has_no_libraries():
    assert declared_packages("no-such-distribution") == ()


def test_the_workers_distribution_beside_ours_is_seen(tmp_path, monkeypatch):
    assert installed_distributions() == ("drivetwin",)
    install(tmp_path, "drivetwin_worker", "0.1", "")
    monkeypatch.syspath_prepend(tmp_path)
    assert installed_distributions() == ("drivetwin", "drivetwin-worker")
    facts = look_at_machine(tmp_path, 7447)
    (line,) = [line for line in findings(facts) if line.what == "distributions"]
    assert "pip uninstall drivetwin drivetwin-worker" in line.do


def test_an_old_and_a_missing_library_are_seen(tmp_path, monkeypatch):
    install(tmp_path, "sometool", "1.0", "")
    metadata = next(tmp_path.glob("*.dist-info")) / "METADATA"
    needs = ("numpy~=1.0", "not-a-library~=3.0", "pytest~=99.0; extra == 'test'")
    lines = "".join(f"Requires-Dist: {line}\n" for line in needs)
    metadata.write_text(f"Metadata-Version: 2.1\nName: sometool\nVersion: 1.0\n{lines}")
    monkeypatch.syspath_prepend(tmp_path)
    found = {package.name: package for package in declared_packages("sometool")}
    assert set(found) == {"numpy", "not-a-library"}
    assert found["numpy"].found
    assert not found["numpy"].fits
    assert found["not-a-library"].found == ""


def test_a_port_that_is_taken():
    with socket.socket() as taken:
        taken.bind(("", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert str(port) in port_trouble(port)


def test_a_folder_that_takes_no_file(tmp_path):
    assert folder_trouble(tmp_path) == ""
    assert list(tmp_path.iterdir()) == []
    assert "Not a directory" in folder_trouble(Path("/dev/null"))
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        assert "Permission denied" in folder_trouble(tmp_path)


def test_memory_of_a_control_group_counts(tmp_path):
    whole = memory_bytes(tmp_path / "none")
    (tmp_path / "memory.max").write_text("1000000")
    (tmp_path / "memory.current").write_text("400000")
    (tmp_path / "memory.stat").write_text("anon 200000\nfile 200000\ninactive_file 150000\n")
    assert memory_bytes(tmp_path) == 750000
    (tmp_path / "memory.max").write_text("max")
    assert memory_bytes(tmp_path) == pytest.approx(whole, rel=0.5)


def test_what_is_missing_of_the_run_folder_is_not_made(tmp_path):
    facts = look_at_machine(tmp_path / "a" / "b", 7447)
    assert facts.folder == str(tmp_path)
    assert list(tmp_path.iterdir()) == []
