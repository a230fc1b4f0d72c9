"""What each fact of a machine means: its level, and that there is something to do."""

from dataclasses import replace

import pytest

from conductor.doctor.judging import (
    FILES_MIN,
    MEMORY_BAD_BYTES,
    MEMORY_WARN_BYTES,
    SPACE_BAD_BYTES,
    SPACE_WARN_BYTES,
    YEAR_MIN,
    MachineFacts,
    Package,
    WarpCuda,
    findings,
)

GOOD = MachineFacts(
    python=(3, 12, 1),
    distributions=("drivetwin",),
    packages=(Package("numpy", "~=2.4", "2.4.1", True, "2.4.1"),),
    processor="cpu:x86_64+avx2+fma",
    gpus=("NVIDIA H200",),
    driver="600.10",
    driver_trouble="",
    warp=WarpCuda("13.4", "13.5", ("NVIDIA H200",)),
    vulkan=True,
    sandbox="",
    port=7447,
    port_trouble="",
    folder="/data",
    filesystem="ext4",
    folder_trouble="",
    free_bytes=SPACE_WARN_BYTES,
    cache_trouble="",
    memory_bytes=MEMORY_WARN_BYTES,
    files_max=FILES_MIN,
    clock_year=YEAR_MIN,
    clock_synchronised=True,
    browser="/usr/bin/chromium",
    schedulers=("Slurm",),
)


def test_a_good_machine_is_ready():
    assert {line.level for line in findings(GOOD)} == {"ok"}


def test_a_machine_without_a_gpu_is_ready():
    without = replace(GOOD, gpus=(), driver="", warp=WarpCuda("13.4"))
    assert {line.level for line in findings(without)} == {"ok"}


TROUBLES = [
    ("Python", "bad", {"python": (3, 10, 9)}),
    ("Python", "bad", {"python": (3, 14, 0)}),
    ("distributions", "bad", {"distributions": ("drivetwin", "drivetwin-worker")}),
    ("library", "bad", {"packages": (Package("numpy", "~=2.4", "", False),)}),
    ("library", "bad", {"packages": (Package("numpy", "~=2.4", "2.3.0", False, "2.4.1"),)}),
    ("library", "warn", {"packages": (Package("numpy", "~=2.4", "2.5.0", True, "2.4.1"),)}),
    ("processor", "warn", {"processor": "cpu:aarch64"}),
    ("GPU", "bad", {"driver_trouble": "the NVIDIA driver does not answer: Driver Not Loaded"}),
    ("Warp", "bad", {"warp": WarpCuda(trouble="exit code -11")}),
    ("CUDA", "bad", {"warp": WarpCuda("13.4")}),
    ("CUDA", "warn", {"warp": WarpCuda("13.4", "12.8", ("NVIDIA H200",))}),
    ("Vulkan", "warn", {"vulkan": False}),
    ("sandbox", "warn", {"sandbox": "no bwrap on this machine; install the package bubblewrap"}),
    ("port", "warn", {"port_trouble": "7447: Address already in use"}),
    ("run folder", "bad", {"folder_trouble": "/data: Read-only file system"}),
    ("run folder", "warn", {"filesystem": "tmpfs"}),
    ("run folder", "warn", {"filesystem": "nfs4"}),
    ("space", "warn", {"free_bytes": SPACE_WARN_BYTES - 1}),
    ("space", "warn", {"free_bytes": SPACE_BAD_BYTES}),
    ("space", "bad", {"free_bytes": SPACE_BAD_BYTES - 1}),
    ("cache", "bad", {"cache_trouble": "cache /tmp/c: others may write to it"}),
    ("memory", "warn", {"memory_bytes": MEMORY_WARN_BYTES - 1}),
    ("memory", "warn", {"memory_bytes": MEMORY_BAD_BYTES}),
    ("memory", "bad", {"memory_bytes": MEMORY_BAD_BYTES - 1}),
    ("files", "warn", {"files_max": FILES_MIN - 1}),
    ("clock", "bad", {"clock_year": YEAR_MIN - 1}),
    ("clock", "warn", {"clock_synchronised": False}),
]


@pytest.mark.parametrize(("what", "level", "change"), TROUBLES)
def test_a_trouble_is_one_line_with_what_to_do_and_a_page(what, level, change):
    troubles = [line for line in findings(replace(GOOD, **change)) if line.level != "ok"]
    assert [(line.what, line.level) for line in troubles] == [(what, level)]
    assert troubles[0].found
    assert troubles[0].do
    assert troubles[0].page


def test_a_missing_library_and_its_version_are_named():
    old = Package("numpy", "~=2.4", "2.3.0", False)
    line = next(line for line in findings(replace(GOOD, packages=(old,))) if line.level == "bad")
    assert "numpy 2.3.0" in line.found
    assert "pip install 'numpy~=2.4'" in line.do


def test_a_clock_of_which_nothing_is_known_is_no_trouble():
    lines = findings(replace(GOOD, clock_synchronised=None))
    assert {line.level for line in lines} == {"ok"}


def test_every_page_is_there():
    from pathlib import Path

    root = Path(__file__).parents[4]
    changes = [GOOD, *(replace(GOOD, **change) for _, _, change in TROUBLES)]
    pages = {line.page.partition("#")[0] for facts in changes for line in findings(facts)} - {""}
    assert len(pages) > 5
    assert all((root / page).is_file() for page in pages), pages
