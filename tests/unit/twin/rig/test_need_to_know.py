"""What a stack gets to see: no truth, name or seed but where its campaign gives them."""

import numpy as np
import pytest
from case_changes import changed
from msgspec import json

from devkit.reference.lights import LightsSwitch, LightSurroundings, sense
from schemas.identity import case_digest, rig_key, stack_name, stack_seed
from schemas.messages import Episode
from schemas.plan import expand, parse_campaign
from schemas.sections.perception import GroundTruthPerception, NetworkPerception
from twin.rig.need_to_know import (
    EXTINCTION_STEPS_PER_M,
    ILLUMINANCE_STEPS_LX,
    as_told,
    stepped,
)
from twin.sensors.data import SensorData


def cases(**autonomy):
    campaign, mistakes = parse_campaign(
        {
            "campaign": "secret_campaign",
            "seed": 123_456_789_123,
            "autonomy": {
                "perception": {
                    "truth": {"type": "ground_truth"},
                    "net": {"type": "network", "model": "yolov3-tiny"},
                },
                **autonomy,
            },
            "matrix": {
                "weather": ["heavy_fog"],
                "time_of_day": ["13:37"],
                "model": ["truth", "net"],
            },
        }
    )
    assert not mistakes, mistakes
    found = {type(case.variation.perception): case for case in expand(campaign)}
    return found[GroundTruthPerception], found[NetworkPerception]


def readings():
    boxes = np.arange(3 * 2 * 7, dtype=np.float32).reshape(3, 2, 7) + 1
    return {
        "vehicle": SensorData(np.ones((3, 7))),
        "environment": SensorData(np.array([[1234.5, 0.0203], [1234.5, 0.0203], [0.0, 0.0]])),
        "boxes": SensorData(boxes, np.array([2, 2, 0], np.int32)),
        "boxes.left": SensorData(boxes.copy(), np.array([1, 1, 0], np.int32)),
    }


def test_in_a_mixed_rig_truth_reaches_the_slots_that_have_a_right_to_it():
    truth, network = cases()
    sensed = readings()
    told = as_told(sensed, [truth, network, None])
    for name in ("boxes", "boxes.left"):
        assert np.array_equal(told[name].values[0], sensed[name].values[0])
        assert not told[name].values[1].any()
        assert told[name].count[1] == 0
        assert told[name].count[0] == sensed[name].count[0]
        assert sensed[name].values[1].any(), "viewers get them from here"
    assert told["environment"].values[0].tolist() == [1234.5, 0.0203]
    assert not np.isin(told["environment"].values[1], [1234.5, 0.0203]).any()
    assert told["environment"].values[2].tolist() == [0.0, 0.0]
    assert told["vehicle"] is sensed["vehicle"]


def test_a_campaign_may_give_the_truth_to_any_stack():
    _, network = cases(tell=["truth"])
    sensed = readings()
    assert as_told(sensed, [network, network, None]) is sensed


def test_lights_burn_alike_by_the_exact_environment_and_by_its_steps():
    rng = np.random.default_rng(5)
    lux = np.append(10 ** rng.uniform(-4, 5.5, 2000), [0.0, 1000.0, 2000.0, 1999.999])
    extinction = np.append(10 ** rng.uniform(-5, 0, 2000), [0.0, 0.0045, 0.006, 0.00600001])
    shown_lux = stepped(lux, ILLUMINANCE_STEPS_LX)
    shown_extinction = stepped(extinction, EXTINCTION_STEPS_PER_M)
    exact = shown = LightSurroundings()
    for i in range(len(lux)):
        exact = sense(exact, lux[i], extinction[i], LightsSwitch())
        shown = sense(shown, shown_lux[i], shown_extinction[i], LightsSwitch())
        assert exact == shown, (lux[i], extinction[i])
    assert len(np.unique(shown_lux)) < 50


def test_an_episode_names_no_case_and_no_seed():
    for case in cases():
        episode = Episode.of(case, seq=0, slot=0, token=1, cameras=[], lidars=[])
        said = json.encode(episode).decode()
        for secret in (
            case.id,
            case.variation.weather,
            case.variation.campaign,
            "123456789123",
            "13:37",
        ):
            assert secret not in said
        assert (episode.case, episode.seed) == (stack_name(case), stack_seed(case))


def test_name_and_seed_are_the_same_again_and_those_of_nobody_else():
    one, other = cases()
    again, _ = cases()
    assert (stack_name(one), stack_seed(one)) == (stack_name(again), stack_seed(again))
    elsewhere = changed(one, seed=one.variation.seed + 1)
    foreign = changed(one, campaign="other")
    assert len({stack_name(case) for case in (one, other, elsewhere, foreign)}) == 4
    assert len({stack_seed(case) for case in (one, other, elsewhere)}) == 3


@pytest.mark.parametrize("tell", [["case"], ["seed"], ["seed", "case"]])
def test_a_campaign_may_tell_them(tell):
    plain, _ = cases()
    case, _ = cases(tell=tell)
    assert (stack_name(case) == case.id) == ("case" in tell)
    assert (stack_seed(case) == case.variation.seed) == ("seed" in tell)
    assert case_digest(case) != case_digest(plain)
    assert rig_key(case) == rig_key(plain)


@pytest.mark.parametrize("tell", [["case", "case"], ["name"], "case"])
def test_what_cannot_be_told_is_refused(tell):
    _, mistakes = parse_campaign(
        {"campaign": "c", "autonomy": {"tell": tell}, "matrix": {"weather": ["clear"]}}
    )
    assert [mistake.path.partition("[")[0] for mistake in mistakes] == ["autonomy.tell"]
