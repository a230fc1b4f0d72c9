"""A message that is too large for Zenoh never arrives; its rig ends with the reason."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from twin.fabric.drive import STACK_BYTES_MAX, UNDER_WAY_BYTES_MAX

SCRIPT = Path(__file__).parent / "giant_messages.py"


@pytest.mark.parametrize(
    ("size", "beside", "link"),
    [
        # Just above the limit: it arrives, and says its size.
        (17_000_000, "", "tcp"),
        # Zenoh drops it, whether the tick is answered beside it or not.
        (1_100_000_000, "", "tcp"),
        (200_000_000, "beside", "tcp"),
        # Nobody counts the bytes of a socket, so less is known of a message that never comes.
        (17_000_000, "", "socket"),
        (1_100_000_000, "", "socket"),
        (1_100_000_000, "beside", "socket"),
    ],
)
def test_a_giant_ends_its_rig_and_costs_little_memory(size, beside, link):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(size), beside, link],
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)
    told = f"message of {size} bytes, at most 16777216 are accepted"
    if size > UNDER_WAY_BYTES_MAX:
        told = told.replace(f"{size}", f"more than {UNDER_WAY_BYTES_MAX}")
        if link == "socket":
            told = "no message comes of it; at most 16777216 bytes in one are accepted"
    assert told in found["reason"]
    # What is put together, once more where it is handed over, and the socket's buffers.
    assert found["growth"] < 2 * STACK_BYTES_MAX + (64 << 20)
