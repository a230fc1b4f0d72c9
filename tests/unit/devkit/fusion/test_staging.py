"""The partial brake comes first, and the full one where it would not do."""

import numpy as np
import pytest

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.parameters import StagingParameters
from devkit.fusion.staging import Stages
from devkit.fusion.threats import Threats


@pytest.mark.parametrize(
    ("stands", "needed_mps2", "brake"),
    [(True, 1.0, 0.0), (True, 4.4, 0.4), (True, 4.6, 1.0), (False, 2.9, 0.4), (False, 3.1, 1.0)],
)
def test_the_full_brake_comes_later_for_what_stands(stands, needed_mps2, brake):
    there, ego = np.ones((1, 1), bool), EgoMotion(1)
    ego.speed_mps[:] = 11.0
    threats = Threats(
        **dict.fromkeys(("agreed", "single", "foreseen", "blocking"), there),
        gap_m=np.full((1, 1), 20.0),
        ttc_s=np.full((1, 1), 1.8),
        needed_mps2=np.full((1, 1), needed_mps2),
        stands=np.full((1, 1), stands),
    )
    plan = Stages(1, StagingParameters()).update(threats, ego, np.full(1, 0.05))
    assert plan.brake[0] == brake
