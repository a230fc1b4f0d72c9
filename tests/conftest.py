"""Being here puts ``tests/`` on the import path, for the modules that tests share."""

from pathlib import Path

import pytest

CLUSTER = (
    *("test_containers", "test_offline", "test_pbs_wrapper", "test_slurm", "test_slurm_nodes"),
    *("test_two_clusters", "test_two_hosts"),
)
"""They make networks and schedulers on this machine."""


LONG = (
    *("test_edges", "test_storms", "test_nothing_left", "test_hand_on_a_case", "test_viewer"),
    *("test_same_verdicts", "test_viewer_web", "test_conductor_restart", "test_workers"),
    *("test_conductor_swarm",),
)
"""Files that take longest, after those of :data:`CLUSTER`."""


def pytest_configure(config: pytest.Config) -> None:
    """pytest-xdist would begin with the groups of most tests, which are quick ones."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs on one core, one after the other, when tests run on several: those of one file,
    because they share fixtures, and those of :data:`CLUSTER`, because there is one machine.

    Long groups come first, the longest of them first: whoever begins one of them last keeps the
    other cores waiting.
    """
    first = {name: place for place, name in enumerate((*CLUSTER, *LONG))}
    items.sort(key=lambda item: first.get(Path(item.path).stem, len(first)))
    for item in items:
        name = Path(item.path).stem
        group = "cluster" if name in CLUSTER else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
