"""A message that is too large for Zenoh never arrives; its rig ends with the reason."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from twin.fabric.drive import STACK_BYTES_MAX, UNDER_WAY_BYTES_MAX

SCRIPT = Path(__file__).parent / "giant_messages.py"


@pytest.mark.parametrize(
    ("size", "beside"),
    [
        # Just above the limit: it arrives, and says its size.
        (17_000_000, ""),
        # Zenoh drops it, whether the tick is answered beside it or not.
        (1_100_000_000, ""),
        (200_000_000, "beside"),
    ],
)
def test_a_giant_ends_its_rig_and_costs_little_memory(size, beside):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(size), beside], capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    told = size if size < UNDER_WAY_BYTES_MAX else f"more than {UNDER_WAY_BYTES_MAX}"
    assert f"message of {told} bytes, at most 16777216 are accepted" in found["reason"]
    # What is put together, once more where it is handed over, and the socket's buffers.
    assert found["growth"] < 2 * STACK_BYTES_MAX + (64 << 20)
