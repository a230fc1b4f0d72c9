"""Completion in bash: the script that a command shows, and the one that it installs, complete."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = {
    "conductor": ("conductor repl", "replay-log"),
    "twin": ("twin validate sce", "scene\nscenario"),
    "devkit": ("devkit quan", "quantize"),
    "viewer": ("viewer repl", "replay"),
    "hpc": ("hpc fetch im", "image"),
    "drivetwin": ("drivetwin --vers", "--version"),
}
"""Command -> words of a line, the last of them begun, and what completes it."""

pytestmark = pytest.mark.skipif(not shutil.which("bash"), reason="needs bash")


def bash(tmp_path: Path, script: str) -> str:
    """What a script of bash prints, with an empty home folder and commands of this Python."""
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    for name in COMMANDS:
        path = bin_folder / name
        path.write_text(
            f"#!{sys.executable}\nimport sys\nsys.argv[0] = {name!r}\n"
            f"from {name}.cli import main\nmain()\n"
        )
        path.chmod(0o755)
    home = {"HOME": str(tmp_path), "PATH": f"{bin_folder}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "--norc", "-c", script],
        capture_output=True,
        text=True,
        env={**os.environ, **home, "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def completed(line: str) -> str:
    """Bash that asks a loaded completion for the end of ``line``, and prints what it says."""
    words = " ".join(f"'{word}'" for word in line.split())
    name = line.split()[0]
    return (
        f"COMP_WORDS=({words}); COMP_CWORD={len(line.split()) - 1}; "
        f"_{name}_completion {name}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_the_shown_script_completes(tmp_path, name):
    line, end = COMMANDS[name]
    shown = f'script=$({name} --show-completion); eval "$script"; {completed(line)}'
    assert bash(tmp_path, shown) == end


def test_the_installed_script_completes(tmp_path):
    (tmp_path / ".bashrc").write_text("# mine\n")
    line, end = COMMANDS["conductor"]
    said = bash(
        tmp_path,
        f"said=$(conductor --install-completion); . ~/.bashrc; {completed(line)}",
    )
    assert said == end
    assert (tmp_path / ".bashrc").read_text().startswith("# mine\n"), "what was there stays"
