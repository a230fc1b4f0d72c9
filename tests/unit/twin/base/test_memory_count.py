"""twin.base.gpu.slot_count: asks a real `twin memory`, and waits for none that is not needed."""

import msgspec
import psutil
import pytest
from waiting import PATIENCE_S

from conductor.run.source import load
from twin.base.gpu.slot_count import MemoryCount

CAMPAIGN = msgspec.json.encode(load("chaos-16").campaign)


def test_it_counts(monkeypatch):
    monkeypatch.setattr("twin.base.gpu.slot_count.TIMEOUT_S", PATIENCE_S)
    few, many = (MemoryCount(CAMPAIGN, ("--campaign", "-", "--free-gb", gb)) for gb in ("1", "10"))
    assert 0 < few.slots() < many.slots()


@pytest.mark.parametrize(
    "of", [pytest.param(b"", marks=pytest.mark.slow), b"{}", b"\xff" * 200_000]
)
def test_what_it_cannot_count_is_left_open(of):
    assert MemoryCount(of, ("--campaign", "-", "--free-gb", "1")).slots() is None


def test_one_that_nobody_asks_leaves_nothing():
    before = set(psutil.Process().children())
    count = MemoryCount(CAMPAIGN, ("--campaign", "-", "--free-gb", "1"))
    (child,) = set(psutil.Process().children()) - before
    count.discard()
    count.discard()
    assert not child.is_running()
