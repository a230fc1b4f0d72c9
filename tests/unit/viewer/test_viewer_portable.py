"""The viewer starts where the simulator cannot: without warp, fcntl and /dev/shm (a laptop)."""

import subprocess
import sys
import textwrap

from unit.viewer.recorded_case import write
from waiting import PATIENCE_S

GUARD = """
import importlib, pkgutil, sys
from importlib.abc import MetaPathFinder

MISSING = {"warp", "fcntl"}

class Guard(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"no {name} here", name=name)

def no_shared_memory(event, arguments):
    if event == "open" and str(arguments[0]).startswith("/dev/shm"):
        raise FileNotFoundError(arguments[0])

assert not MISSING & set(sys.modules)
sys.meta_path.insert(0, Guard())
sys.addaudithook(no_shared_memory)
"""


def guarded(code, *arguments):
    """Run ``code`` in a Python that lacks what a laptop lacks."""
    done = subprocess.run(
        [sys.executable, "-c", GUARD + textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_guard_guards():
    assert "guarded" in guarded(
        """
        for name in ("warp", "fcntl"):
            try:
                importlib.import_module(name)
            except ModuleNotFoundError:
                continue
            sys.exit(f"{name} came in")
        try:
            open("/dev/shm/x")
        except FileNotFoundError as error:
            print("guarded", error)
        """
    )


def test_every_module_of_the_viewer_the_fabric_and_the_schemas_imports():
    names = guarded(
        """
        for root in ("schemas", "twin.fabric", "viewer"):
            package = importlib.import_module(root)
            for found in pkgutil.walk_packages(package.__path__, root + "."):
                if not found.name.endswith("__main__"):
                    importlib.import_module(found.name)
                    print(found.name)
        """
    ).split()
    assert {"viewer.live.command", "viewer.browser.front", "twin.fabric.zenoh_bus"} <= set(names)


def test_its_commands_run(tmp_path):
    write(tmp_path / "cases" / "clear-1" / "attempt-1")
    run = """
        from viewer.cli import main
        sys.argv[0] = "viewer"
        main()
    """
    assert "replay" in guarded(run, "--help")
    film, log = tmp_path / "a.mp4", tmp_path / "a.mcap"
    told = guarded(run, "export", tmp_path, "clear-1", "--mp4", film, "--mcap", log)
    assert "3 frames at 10 Hz" in told
    assert film.stat().st_size > 1000
    assert log.stat().st_size > 1000
    assert "clear-1" in guarded(run, "replay", tmp_path, "--output", "json")
