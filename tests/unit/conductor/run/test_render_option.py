"""``--render``: a campaign with cameras that see, or that do not."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from conductor.run.source import load
from schemas.plan import Plan
from twin.base.errors import UsageError

CAMPAIGN = {
    "campaign": "c",
    "control_hz": 50,
    "autonomy": {"stack": "devkit.idle:IdleStack"},
    "matrix": {"weather": ["clear"]},
}


def loaded(folder: Path, option: bool | None, **more: object) -> Plan:
    """A campaign file whose stack needs no camera, with the option."""
    path = folder / "c.yaml"
    path.write_text(yaml.safe_dump({**CAMPAIGN, **more}))
    return load(str(path), render=option)


def test_cameras_are_switched_on_and_off(tmp_path: Path) -> None:
    seeing = loaded(tmp_path, None, camera={"hz": 25})
    blind = loaded(tmp_path, False, camera={"hz": 25})
    assert [case.rig.render for case in seeing.cases] == [True]
    assert [case.rig.render for case in blind.cases] == [False]
    again = loaded(tmp_path, True, camera={"hz": 25}, render=False)
    assert again.cases == seeing.cases


def test_a_camera_that_is_switched_off_may_have_any_rate(tmp_path: Path) -> None:
    for render, in_file in ((False, True), (False, False), (None, False)):
        (case,) = loaded(tmp_path, render, camera={"hz": 20}, render=in_file).cases
        assert not case.rig.render


@pytest.mark.parametrize(("render", "in_file"), [(True, False), (None, True)])
def test_a_rate_that_only_blind_cameras_may_have_is_refused(
    tmp_path: Path, render: bool | None, in_file: bool
) -> None:
    with pytest.raises(UsageError, match=r"c\.yaml: camera\.hz: given 20, allowed: a divisor"):
        loaded(tmp_path, render, camera={"hz": 20}, render=in_file)


def test_a_stack_that_drives_by_a_camera_is_not_blinded(tmp_path: Path) -> None:
    stack = {"autonomy": {"stack": "devkit.aeb:AebStack"}, "control_hz": 20}
    with pytest.raises(UsageError, match=r"^--render: stack devkit\.aeb:AebStack drives by a"):
        loaded(tmp_path, False, **stack)
    with pytest.raises(UsageError, match=r"c\.yaml: render: stack devkit\.aeb:AebStack"):
        loaded(tmp_path, None, render=False, **stack)
