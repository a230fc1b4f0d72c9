"""Being here puts ``tests/`` on the import path, for the modules that tests share."""

from pathlib import Path

import pytest

CLUSTER = (
    *("test_containers", "test_faults", "test_offline", "test_pbs_wrapper", "test_slurm"),
    *("test_slurm_nodes", "test_two_clusters", "test_two_hosts"),
)
"""They make networks and schedulers on this machine."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs on one core, one after the other, when tests run on several: those of one file,
    because they share fixtures, and those of :data:`CLUSTER`, because there is one machine."""
    for item in items:
        name = Path(item.path).stem
        group = "cluster" if name in CLUSTER else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
