"""A kernel cache that cannot be written is replaced by a folder that nobody else can fill."""

import os
import subprocess
import sys
import tempfile

import warp as wp

from twin.world.kernel_cache import _fallback, prepare_kernels


def test_one_line_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    prepare_kernels()
    assert capsys.readouterr().err == ""
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(blocked / "cache"))
    prepare_kernels()
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be written" in line
    assert wp.config.kernel_cache_dir != str(blocked / "cache")


def test_fallback_is_private_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = _fallback()
    assert folder == tmp_path / f"drivetwin-kernels-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert _fallback() == folder


def test_a_folder_that_others_can_write_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"drivetwin-kernels-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    assert _fallback() != planted


def test_a_link_is_not_followed(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    planted = tmp_path / f"drivetwin-kernels-{os.getuid()}"
    planted.symlink_to(target)
    assert _fallback() != planted


START = """
import os, threading
import warp as wp
from twin.world.kernel_cache import prepare_kernels
real = wp.init
def init():
    os.write(2, b"of another library\\n")
    real()
wp.init = init
prepare_kernels()
prepare_kernels()
os.write(2, b"afterwards\\n")
"""


def test_a_machine_without_a_gpu_is_no_warning_and_other_lines_pass():
    done = subprocess.run([sys.executable, "-c", START], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == "of another library\nafterwards\n"
