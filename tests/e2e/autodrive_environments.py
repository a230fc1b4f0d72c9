"""Python environments in which scripts of the AutoDRIVE devkit run: of 2020, and of today."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parent / "autodrive_script.py"

OF_2020 = (
    *("python-socketio==4.2.0", "python-engineio==3.13.0", "eventlet==0.33.3", "Flask==1.1.1"),
    *("werkzeug==1.0.1", "jinja2==2.11.3", "itsdangerous==2.0.1", "markupsafe==2.0.1"),
    *("pillow==10.4.0", "greenlet==3.1.1", "dnspython==2.6.1"),
)
"""What the devkit pins, and what fits to it."""

TODAY = ("socketio", "eventlet", "flask", "websockets")


def missing_today():
    """Which packages of today's environment are not installed, in words, or nothing."""
    missing = [name for name in TODAY if importlib.util.find_spec(name) is None]
    return f"not installed: {', '.join(missing)}" if missing else ""


def python_3_8():
    """A Python 3.8 of this machine, or None."""
    candidates = [shutil.which("python3.8")]
    candidates += sorted(map(str, Path.home().glob(".pyenv/versions/3.8.*/bin/python3.8")))
    for found in filter(None, candidates):
        # A shim of pyenv may be there without the version behind it.
        if subprocess.run([found, "--version"], capture_output=True).returncode == 0:
            return found
    return None


def environment_of_2020(python, folder):
    """The interpreter of a new environment with the pins, from the package registry."""
    subprocess.run([python, "-m", "venv", str(folder)], check=True)
    pip = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet", *OF_2020]
    # With it, pip would count packages of another Python as installed.
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(pip, capture_output=True, text=True, env=variables)
    assert done.returncode == 0, done.stderr
    return str(folder / "bin/python")


def today():
    """The interpreter of the tests."""
    return sys.executable
