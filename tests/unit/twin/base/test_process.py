"""Logs of children: bounded on the disk while they are written, whatever is printed."""

import os
import subprocess
import sys
import tempfile

import pytest

from twin.base.process import bound_log, end, last_lines, spawn

MAX_BYTES, PART_BYTES = 6 << 20, 1 << 20

WORDS = """
import os, sys
os.write(2, b"the beginning\\n")
for _ in range(3):
    for _ in range(50):
        os.write(2, b"x" * 100_000 + b"\\n")
    os.read(0, 1)  # until it was looked at
os.write(2, b"the end\\n")
os.read(0, 1)
"""


def disk_bytes(log):
    return os.fstat(log.fileno()).st_blocks * 512


def test_a_log_without_end_fills_no_disk(monkeypatch):
    """Its head and its tail stay, and what is printed next comes behind."""
    monkeypatch.setattr("twin.base.process.LOG_BYTES_MAX", MAX_BYTES)
    monkeypatch.setattr("twin.base.process.LOG_PART_BYTES", PART_BYTES)
    with tempfile.TemporaryFile() as log:
        child = spawn([sys.executable, "-c", WORDS], log=log)
        try:
            for megabytes in (5, 10, 15):
                while os.fstat(log.fileno()).st_size < megabytes * 1_000_000:
                    assert child.poll() is None
                bound_log(log)
                assert disk_bytes(log) <= MAX_BYTES
                os.write(child.stdin.fileno(), b"x")
            while "the end" not in last_lines(log):
                assert child.poll() is None
            bound_log(log)
            assert os.pread(log.fileno(), 14, 0) == b"the beginning\n"
            assert os.pread(log.fileno(), 10, PART_BYTES + 9999) == bytes(10)
            assert last_lines(log).endswith("the end")
        finally:
            end(child)


def test_a_small_log_stays_as_it_is():
    with tempfile.TemporaryFile() as log:
        log.write(b"one\ntwo\n")
        log.flush()
        bound_log(log)
        assert last_lines(log) == "one | two"


FREED = """
import sys
from pathlib import Path
from twin.base.process import give_freed_memory_back

def pages():
    return int(Path("/proc/self/statm").read_text().split()[1])

print(sys.argv[1] == "as usual" or give_freed_memory_back())
bytearray(b"x") * (30 << 20)  # from then on glibc keeps what is smaller
before = pages()
blocks = [bytearray(b"x") * (1 << 20) for _ in range(24)]
del blocks
print((pages() - before) * 4096 >> 20)
"""


def test_freed_memory_goes_back_to_the_system():
    kept_mb = []
    for how in ("as usual", "given back"):
        done = subprocess.run([sys.executable, "-c", FREED, how], capture_output=True, text=True)
        known, kept = done.stdout.split()
        if known == "False":
            pytest.skip("needs glibc")
        kept_mb.append(int(kept))
    assert kept_mb[0] >= 20
    assert kept_mb[1] <= 4
