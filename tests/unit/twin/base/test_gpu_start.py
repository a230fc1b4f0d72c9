"""twin.base.gpu.first_use: a process begins to use a GPU once, in its turn. A library that notes
what it is asked stands for the driver, which is not on every machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from c_library import compiled

from conductor.run.gpu_turns import turns
from twin.base.gpu.first_use import begin, begun

DRIVER = """
#include <stdio.h>
#include <stdlib.h>
static int note(const char *what, int number) {
    FILE *notes = fopen(getenv("NOTES"), "a");
    fprintf(notes, "%s %d\\n", what, number);
    fclose(notes);
    return 0;
}
int cuInit(unsigned flags) { return note("init", flags) + (getenv("BROKEN") != NULL); }
int cuDeviceGet(int *device, int ordinal) { *device = 40 + ordinal; return 0; }
int cuDevicePrimaryCtxRetain(void **context, int device) { return note("retain", device); }
"""

BEGIN = """
from twin.base.gpu.first_use import begin, begun
for _ in range(2):
    begin("{device}")
    begun("{device}")
"""


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("driver"), "libcuda.so.1", DRIVER)


def run(driver, tmp_path, device, **variables):
    """What the driver was asked by a process that begins to use ``device`` twice."""
    notes = tmp_path / "notes"
    environment = {**os.environ, "LD_LIBRARY_PATH": str(driver), "NOTES": str(notes), **variables}
    code = BEGIN.format(device=device)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return notes.read_text() if notes.exists() else ""


def test_a_gpu_is_begun_once(driver, tmp_path):
    assert run(driver, tmp_path, "cuda:3") == "init 0\nretain 43\n"


def test_in_a_turn_where_there_are_turns(driver, tmp_path):
    with turns("cuda:0"):
        for _ in range(5):  # more than begin at once: each gives its turn back
            run(driver, tmp_path, "cuda:0")
    assert (tmp_path / "notes").read_text() == "init 0\nretain 40\n" * 5


def test_one_that_does_not_work_is_left_to_who_needs_it(driver, tmp_path):
    assert run(driver, tmp_path, "cuda:0", BROKEN="1") == "init 0\n"


def test_without_a_driver_nothing_happens(monkeypatch):
    """And nothing is raised, in the thread or by it."""
    monkeypatch.setattr("ctypes.CDLL", lambda name: (_ for _ in ()).throw(OSError(name)))
    monkeypatch.setattr("threading.excepthook", lambda raised: failed.append(raised))
    failed: list = []
    begin("cuda:7")
    begun("cuda:7")
    assert failed == []


@pytest.mark.parametrize("device", ["cpu", "cuda:x"])
def test_nothing_happens_on_a_cpu_or_what_is_no_device(driver, tmp_path, device):
    assert "retain" not in run(driver, tmp_path, device)
