"""Being here puts ``tests/`` on the import path, for the modules that tests share; and which tests
pytest-xdist runs together in one process."""

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

# Thousands of processes are started, in environments that were installed without compiled modules:
# they compile once, also where the environment of an image says that nothing is to be kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

if "DRIVETWIN_HOME" not in os.environ:  # runs are signed, with a key that no test's owner keeps
    os.environ["DRIVETWIN_HOME"] = tempfile.mkdtemp(prefix="drivetwin-home-")
    atexit.register(shutil.rmtree, os.environ["DRIVETWIN_HOME"], ignore_errors=True)

CLUSTER = (
    *("test_containers", "test_faults", "test_offline", "test_pbs_wrapper", "test_slurm"),
    *("test_slurm_nodes", "test_two_clusters", "test_two_hosts"),
)
"""They make networks and schedulers on this machine, and there is one machine."""
APART = (
    *("test_edges", "test_zombies", "test_nothing_left", "test_same_verdicts"),
    *("test_conductor_restart", "test_workers", "test_bad_input", "test_foreign_stacks"),
)
"""Long files whose tests share only what is run once for all processes: each runs anywhere."""
LONG = ("test_viewer", "test_viewer_web", "test_hand_on_a_case", "test_conductor_swarm")
"""Further long files."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long ones come first: whoever begins one of them last keeps the other cores waiting."""
    first = {name: place for place, name in enumerate((*CLUSTER, *LONG, *APART))}
    items.sort(key=lambda item: first.get(Path(item.path).stem, len(first)))


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
