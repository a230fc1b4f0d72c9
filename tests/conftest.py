"""Being here puts ``tests/`` on the import path, for the modules that tests share; and which tests
pytest-xdist runs together in one process."""

import atexit
import gc
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from again import Ends

# Thousands of processes are started, in environments that were installed without compiled modules:
# they compile once, also where the environment of an image says that nothing is to be kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Conductors make keys in their user's own folder; that of the tests goes with them.
if "DRIVETWIN_HOME" not in os.environ or "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["DRIVETWIN_HOME"] = tempfile.mkdtemp(prefix="drivetwin-home-")
    atexit.register(shutil.rmtree, os.environ["DRIVETWIN_HOME"], ignore_errors=True)

CLUSTER = (
    *("test_containers", "test_faults", "test_kubernetes", "test_offline", "test_pbs_wrapper"),
    *("test_scale", "test_sites", "test_slurm", "test_slurm_nodes", "test_two_clusters"),
    "test_two_hosts",
)
"""They make networks and schedulers on this machine, and there is one machine."""
APART = (
    *("test_edges", "test_zombies", "test_nothing_left", "test_same_verdicts"),
    *("test_conductor_restart", "test_workers", "test_bad_input", "test_foreign_stacks"),
    "test_tutorials",
)
"""Long files whose tests share only what is run once for all processes: each runs anywhere."""
LONG = ("test_viewer", "test_viewer_web", "test_intervene_in_a_case", "test_conductor_swarm")
"""Further long files."""

IMPORTS = {"playwright": "browser", "torch": "train"}
"""Mark of every file of tests that imports a package, which the quick lane does not install."""
FOLDERS = {"e2e": "e2e", "faults": "faults", "redteam": "faults"}
"""Mark of every file in a folder of tests."""
_IMPORT = re.compile(rf"^\s*(?:from|import) ({'|'.join(IMPORTS)})\b", re.MULTILINE)


@pytest.fixture
def hub() -> Iterator[Any]:
    """A bus in memory, whose messages a thread passes on."""
    from twin.fabric.memory_bus import MemoryHub

    hub = MemoryHub()
    thread = hub.run()
    yield hub
    hub.stop()
    thread.join()


@cache
def marks_of(path: Path) -> set[str]:
    """What a file of tests needs beyond Python and a core."""
    marks = {IMPORTS[package] for package in _IMPORT.findall(path.read_text())}
    marks |= {mark for folder, mark in FOLDERS.items() if folder in path.parts}
    return marks | ({"cluster"} if path.stem in CLUSTER else set())


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--lane quick`` is what ``make test`` runs."""
    parser.addoption(
        "--lane",
        choices=("quick", "rest", "all"),
        default="all",
        help="quick: neither processes and clusters nor browsers and torch, but one run of every "
        "command; rest: what that leaves out; all: everything (default)",
    )
    parser.addoption(
        "--part", default="0/1", help="K/N: of the lane's files the K-th of N parts, from 0 on"
    )


def pytest_configure(config: pytest.Config) -> None:
    """For ``tests/again.py``, which runs what failed once more."""
    if getattr(config, "cache", None) is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Ends())


def pytest_collection_finish() -> None:
    """Thousands of tests lie in memory until the end: no collection of garbage goes through them
    again, which took a sixth of the time."""
    gc.freeze()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """A lane does not even import files that have none of its tests: their packages may be missing,
    and what is not collected takes no time and no memory."""
    lane = config.getoption("lane")
    if lane == "all" or not collection_path.name.startswith("test_"):
        return None
    return None if lane in _lanes_of(collection_path) else True


@cache
def _lanes_of(path: Path) -> set[str]:
    """Lanes that may have tests of a file, by what its text says."""
    quick, text = in_quick_lane(path), path.read_text()
    has = {"quick": quick, "rest": not quick or "pytest.mark.slow" in text}
    return {lane for lane, there in has.items() if there}


def _lane_of(item: pytest.Item) -> str:
    slow = item.get_closest_marker("slow") or not in_quick_lane(Path(item.path))
    return "rest" if slow else "quick"


@cache
def in_quick_lane(path: Path) -> bool:
    """Whether the quick lane runs a file's tests, but for slow ones."""
    return not marks_of(path) or "pytest.mark.quick" in path.read_text()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long ones come first: whoever begins one of them last keeps the other cores waiting."""
    if (lane := config.getoption("lane")) != "all":
        for item in items:
            if _lane_of(item) not in _lanes_of(Path(item.path)):
                raise pytest.UsageError(f"{item.nodeid}: no lane finds it; its file names no mark")
        part, parts = (int(number) for number in config.getoption("part").split("/"))
        chosen = [item for item in items if _lane_of(item) == lane]
        files = {*sorted({item.path for item in chosen})[part::parts]}
        chosen = [item for item in chosen if item.path in files]
        config.hook.pytest_deselected(items=[*{*items}.difference(chosen)])
        items[:] = chosen
    first = {name: place for place, name in enumerate((*CLUSTER, *LONG, *APART))}
    items.sort(key=lambda item: first.get(Path(item.path).stem, len(first)))
    for item in items:
        for mark in marks_of(item.path):
            item.add_marker(mark)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """One more than there are cores: whoever waits for a time-out, a scheduler or a browser leaves
    its core to another."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    return len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Tests of one file run on one core, one after the other, because they share fixtures.

    Marks of groups would say the same, but pytest-xdist 3.8 does not hand them on under pytest 9.
    """
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            path = nodeid.partition("::")[0]
            name = Path(path).stem
            return "cluster" if name in CLUSTER else nodeid if name in APART else path

    config.option.loadscopereorder = (
        False  # by number of tests, which are quick where they are many
    )
    return Together(config, log)
