"""The cheapest recorded campaign still has its fingerprint: no KPI value has changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from fingerprints import RECORDED, fingerprint_of

from twin.base.software import device_class

CHEAPEST = "chaos-16"


def test_the_cheapest_campaign_keeps_its_fingerprint(tmp_path: Path) -> None:
    recorded = RECORDED[CHEAPEST]
    here = device_class("cpu")
    if recorded["device_class"] != here:
        pytest.skip(f"recorded on {recorded['device_class']}, this is {here}")
    # One worker loads its libraries once; results are the same with any number of them.
    now = fingerprint_of(CHEAPEST, tmp_path / CHEAPEST, "--workers", "1")
    assert now == recorded["fingerprint"]
