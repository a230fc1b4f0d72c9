"""A plan that is restricted or amended is that of the restricted or amended campaign."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.identity import campaign_digest
from schemas.plan import Plan, expand, parse_plan
from schemas.sections.perception import GroundTruthPerception
from schemas.sections.stack_identity import StackIdentity
from schemas.sections.view_mode import Recording

AXES: dict[str, list[Any]] = {
    "model": ["sharp", "dull"],
    "weather": ["clear", "heavy_fog", "drizzle"],
    "time_of_day": ["05:00", "13:00"],
    "repeat": [0, 1, 2],
    "scenario.duration_s": [2, 4.5],
    "camera.hz": [10, 20],
    "autonomy.latency_ms": [0, 50],
    "autonomy.parameters.gain": [1, 1.5],
    "objects.walker.speed_mps": [1.0, 2.0],
    "sensors.gnss.noise_horizontal_m": [0.1, 5.0],
    "environment.exposure_ev100": [12],
}
BASE: dict[str, Any] = {
    "campaign": "c",
    "autonomy": {
        "stack": "devkit.idle:IdleStack",
        "perception": {name: {"type": "ground_truth"} for name in AXES["model"]},
        "parameters": {"gain": 3, "name": "x"},
    },
    "environment": {"custom": {"drizzle": {"rain": 0.2}}},
    "sensors": {"gnss": {}, "imu": {}},
}


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Plans of campaigns with some axes, exclusions, single cases and batches."""
    names = draw(st.lists(st.sampled_from([*AXES][1:]), unique=True, max_size=4))
    matrix = {
        name: draw(st.lists(st.sampled_from(AXES[name]), unique=True, min_size=1))
        for name in ["model", *names]
    }
    first = {name: values[0] for name, values in matrix.items()}
    one = {"model": "dull", "repeat": draw(st.integers(100, 110)), "weather": "cloudy"}
    data = {
        **BASE,
        "seed": draw(st.integers(0, 2**40)),
        "matrix": matrix,
        "exclude": draw(st.sampled_from([[], [first]])),
        "cases": [one],
        "batch": draw(st.sampled_from([None, {"size": 2}, {"size": 3}])),
    }
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    return plan


def is_plan_of_its_campaign(plan: Plan) -> bool:
    """Whether it has the cases that its campaign has, anew from plain data, to the byte."""
    again, mistakes = parse_plan(msgspec.to_builtins(plan.campaign))
    assert again is not None, mistakes
    assert again.campaign == plan.campaign
    encoded = [msgspec.json.encode(each.cases) for each in (plan, again)]
    digests = [campaign_digest(each.campaign, each.cases) for each in (plan, again)]
    return encoded[0] == encoded[1] and digests[0] == digests[1]


unhurried = settings(deadline=None, max_examples=60)


@unhurried
@given(plan=plans(), data=st.data())
def test_of_its_first_cases(plan: Plan, data: st.DataObject) -> None:
    count = data.draw(st.integers(1, len(plan.cases) + 1))
    found = plan.first(count)
    assert [case.id for case in found.cases] == [case.id for case in plan.cases][:count]
    assert is_plan_of_its_campaign(found)


@unhurried
@given(plan=plans(), data=st.data())
def test_of_one_case(plan: Plan, data: st.DataObject) -> None:
    case = data.draw(st.sampled_from(plan.cases))
    found = plan.only(case.id)
    assert found is not None
    assert [each.id for each in found.cases] == [case.id]
    assert is_plan_of_its_campaign(found)
    assert plan.only("no-such") is None


@unhurried
@given(
    plan=plans(),
    seed=st.integers(0, 2**40),
    render=st.booleans(),
    view=st.sampled_from(["live", "record", "none"]),
    keep=st.sampled_from(["all", "failed", "none"]),
    least=st.floats(0.01, 1),
    count=st.integers(1, 5),
)
def test_of_what_is_learnt_or_asked_later(
    plan: Plan, seed: int, render: bool, view: Any, keep: Any, least: float, count: int
) -> None:
    variants = plan.campaign.autonomy.perception | {
        "dull": GroundTruthPerception(contrast_min=least)
    }
    autonomy = msgspec.structs.replace(
        plan.campaign.autonomy, perception=variants, files=["/a/b"], tell=["case"]
    )
    changed = msgspec.structs.replace(
        plan.campaign,
        seed=seed,
        render=render,
        view=view,
        recording=Recording(keep=keep, drive=keep),
        autonomy=autonomy,
        files={"downtown": "1" * 64},
        stack_identity=StackIdentity("2" * 64, named={"x": "3" * 64}),
    )
    found = plan.amended(changed)
    assert found.campaign is changed
    assert {case.variation.seed for case in found.cases} == {seed}
    assert is_plan_of_its_campaign(found)
    assert is_plan_of_its_campaign(found.first(count))
    assert found.cases == expand(changed)
