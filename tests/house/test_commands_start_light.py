"""What a command loads before it knows what it is to do: nothing that takes long."""

import subprocess
import sys

import pytest

HEAVY = (
    *("numpy", "warp", "zenoh", "rerun", "cv2", "cryptography", "importlib.metadata"),
    *("schemas.campaign", "schemas.case", "schemas.messages", "schemas.wire.topics"),
)
"""Modules that no help text needs; the sections of a campaign alone take 30 ms."""
KINDS_IN_HELP = {"hpc": {"importlib.metadata"}}
"""`hpc --scheduler` names the batch systems of other distributions."""


@pytest.mark.parametrize("command", ["twin", "conductor", "viewer", "devkit", "hpc", "drivetwin"])
def test_no_heavy_module_before_the_arguments(command):
    code = f"import {command}.cli, sys; print('\\n'.join(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert f"{command}.cli" in loaded
    assert {name for name in HEAVY if name in loaded} <= KINDS_IN_HELP.get(command, set())


WORKS = (
    *("twin.worker.shell", "twin.rig.sim_process", "twin.rig.inline", "twin.rig.drive_recorder"),
    *("twin.records.drive_record", "twin.view.publisher", "twin.world.meshes.apart"),
    *("devkit.hosting.host", "devkit.aeb", "devkit.fusion", "devkit.idle", "devkit.lane.view"),
    *("devkit.bridges.autodrive", "devkit.bridges.ros2", "devkit.reference.eyes", "hpc.cli"),
)
"""What a worker, a simulator and a stack without a network load."""


def test_opencv_is_for_networks():
    """The distribution of workers is without it, unless they run networks."""
    code = f"import importlib, sys\nfor name in {WORKS}: importlib.import_module(name)\n"
    code += "print('cv2' in sys.modules, 'warp' in sys.modules)"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert said == ["False", "True"]
