"""``hpc enter`` as a stack's command line meets it."""

import shutil
import subprocess
import sys


def test_what_is_not_installed_is_one_line(tmp_path):
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "mkdir").symlink_to(shutil.which("mkdir"))
    image = tmp_path / "image"
    image.mkdir()
    words = ["--container", str(image), "--runtime", "charliecloud", "--gpus", "--", "true"]
    done = subprocess.run(
        [sys.executable, "-m", "hpc", "enter", *words],
        cwd=tmp_path,
        env={"PATH": str(tools), "PYTHONPATH": ":".join(p for p in sys.path if p)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3
    (line,) = done.stderr.splitlines()
    assert "`ch-fromhost` cannot be run" in line
