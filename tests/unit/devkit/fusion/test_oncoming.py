"""Two tracks of one vehicle that comes: the one that radar has followed knows where it goes."""

import numpy as np
import pytest

from devkit.fusion.oncoming import doubles
from devkit.fusion.parameters import TrackingParameters
from devkit.fusion.tracks import TrackStore

FOLLOWED = {"x_m": 27.8, "y_m": 3.0, "vx_mps": -10.8, "age_s": 6.3, "echoes": 58}
"""An oncoming lorry by radar."""
SECOND = {"x_m": 29.0, "y_m": 2.9, "vx_mps": -10.0, "age_s": 1.3, "echoes": 3}
"""Its nose by LiDAR."""


def found(*given):
    """Which of the tracks are second views."""
    tracks = TrackStore(1, TrackingParameters())
    for place, values in enumerate(given):
        tracks.live[0, place] = True
        tracks.radar.age_s[0, place] = values.get("radar_age_s", 0.0)
        tracks.radar.hits[0, place] = values["echoes"]
        for name in ("x_m", "y_m", "vx_mps", "age_s"):
            getattr(tracks, name)[0, place] = values[name]
    return doubles(tracks)[0, : len(given)].tolist()


def test_the_younger_of_two_views_of_one_vehicle_is_the_second():
    assert found(FOLLOWED, SECOND) == [False, True]
    assert found(SECOND, FOLLOWED) == [True, False]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"y_m": 1.2}, "it comes beside the other one"),
        ({"x_m": 32.0}, "it comes behind it"),
        ({"vx_mps": -13.5}, "it overtakes it"),
        ({"vx_mps": -3.0}, "it hardly comes"),
        ({"age_s": 7.0}, "it is the older one"),
        ({"echoes": 60}, "radar has followed it for longer"),
    ],
)
def test_what_is_no_second_view(change, why):
    assert found(FOLLOWED, SECOND | change) == [False, False], why


@pytest.mark.parametrize("change", [{"echoes": 19}, {"radar_age_s": 0.3}, {"vx_mps": -3.0}])
def test_only_what_radar_follows_has_second_views(change):
    assert found(FOLLOWED | change, SECOND) == [False, False]


def test_slots_do_not_depend_on_each_other():
    tracks = TrackStore(2, TrackingParameters())
    for slot, values in enumerate((FOLLOWED, SECOND)):
        tracks.live[slot, slot] = True
        for name in ("x_m", "y_m", "vx_mps", "age_s"):
            getattr(tracks, name)[slot, slot] = values[name]
        tracks.radar.age_s[slot, slot], tracks.radar.hits[slot, slot] = 0.0, values["echoes"]
    assert not np.any(doubles(tracks))
