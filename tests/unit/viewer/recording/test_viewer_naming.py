"""Ids that Rerun keeps as they are."""

import re

import pytest

from viewer.recording import naming


@pytest.mark.parametrize(
    "parts", [("aeb-256", "yolov3-0500-heavy_fog", "1"), ("a.b", "c d/e", "2"), ("ä", "", "3")]
)
def test_ids_hold_only_what_rerun_keeps(parts):
    assert re.fullmatch(r"[A-Za-z0-9_-]+", naming.safe_id(*parts))


def test_a_good_name_stays_as_it_is():
    assert naming.recording_id("aeb-256", "yolov3-0500", 2) == "aeb-256-yolov3-0500-2"


def test_names_that_differ_only_in_what_is_replaced_stay_apart():
    assert naming.safe_id("a.b") != naming.safe_id("a b")
    assert naming.safe_id("a.b") != naming.safe_id("a_b")
