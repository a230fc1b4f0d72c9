"""``--render``: a campaign with cameras that see, or that do not."""

from __future__ import annotations

import pytest

from conductor.run.source import with_render
from schemas.plan import Plan, parse_plan
from twin.base.errors import UsageError

CAMPAIGN = {
    "campaign": "c",
    "control_hz": 50,
    "autonomy": {"stack": "devkit.idle:IdleStack"},
    "matrix": {"weather": ["clear"]},
}


def plan(**more: object) -> Plan:
    """A campaign whose stack needs no camera."""
    found, mistakes = parse_plan({**CAMPAIGN, **more})
    assert found is not None, mistakes
    return found


def test_cameras_are_switched_on_and_off() -> None:
    seeing = plan(camera={"hz": 25})
    blind = with_render(seeing, False)
    assert [case.rig.render for case in blind.cases] == [False]
    assert with_render(blind, True).cases == seeing.cases


def test_a_rate_that_only_blind_cameras_may_have_is_refused() -> None:
    with pytest.raises(UsageError, match=r"--render on: camera\.hz: given 20, allowed: a divisor"):
        with_render(plan(render=False, camera={"hz": 20}), True)


def test_a_stack_that_drives_by_a_camera_is_not_blinded() -> None:
    seeing = plan(autonomy={"stack": "devkit.aeb:AebStack"}, control_hz=20)
    with pytest.raises(UsageError, match=r"--render off: stack devkit\.aeb:AebStack drives by a"):
        with_render(seeing, False)
