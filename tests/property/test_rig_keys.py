"""A rig's key is of all that the rig is built for, and of nothing else."""

from __future__ import annotations

from typing import Any

import pytest
from case_changes import changed
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from schemas.case import Case, RigSpec, Variation
from schemas.identity import rig_key
from schemas.kinds.sensors.imu import Imu
from schemas.plan import expand, parse_campaign
from schemas.sections.camera import Camera
from schemas.sections.environment import Environment
from schemas.sections.foreign import Foreign
from schemas.sections.fork import Fork
from schemas.sections.lidar import Lidar
from schemas.sections.objects import ObjectVariation
from schemas.sections.perception import GroundTruthPerception
from schemas.sections.repeated import CaseOrigin
from schemas.sections.scenario import Scenario
from schemas.sections.sensors import Sensors
from schemas.sections.stack_identity import StackIdentity, StackSource

words = st.text("abcdef", min_size=1, max_size=6)
counts = st.integers(1, 400)
keeps = st.sampled_from(["all", "failed", "none"])
digests = st.dictionaries(words, words, min_size=1, max_size=2)

RIG: dict[str, st.SearchStrategy[Any]] = {
    "simulator": st.sampled_from(["warp", "noop"]),
    "control_hz": counts,
    "clock": st.sampled_from(["lockstep", "realtime"]),
    "scene": words,
    "vehicle": words,
    "camera": counts.map(lambda width: Camera(width=width + 16)),
    "cameras": st.lists(words.map(lambda name: Camera(name=name)), max_size=2),
    "lidars": st.lists(words.map(lambda name: Lidar(name=name)), max_size=2),
    "sensor_hz": st.dictionaries(words, counts, max_size=2),
    "render": st.booleans(),
    "view": st.sampled_from(["none", "live", "record", "record+live"]),
    "keep": keeps,
    "stack": words,
    "foreign": st.none() | words.map(lambda word: Foreign(command=[word])),
    "source": words.map(lambda word: StackSource(identity=StackIdentity(word))),
    "parameters": st.dictionaries(words, counts, max_size=2),
    "slots": counts,
    "placement": st.sampled_from(["worker", "inline", "node"]),
    "models": st.lists(words, max_size=2).map(sorted),  # in any order they are the same
    "sandbox": st.sampled_from(["default", "strict", "off"]),
    "cosim": st.booleans(),
    "bodies": st.integers(0, 32),
}
"""Values of every field of a rig; of its files the contents count, see below."""

VARIATION: dict[str, st.SearchStrategy[Any]] = {
    "id": words,
    "campaign": words,
    "seed": counts,
    "deadline_s": st.floats(1, 100),
    "scenario": st.floats(0, 30).map(lambda speed: Scenario(ego_speed_mps=speed)),
    "sensors": st.booleans().map(lambda noise: Sensors(imu=Imu(noise=noise))),
    "environment": st.just(Environment()),
    "latency_ms": counts,
    "latency_jitter_ms": counts,
    "rate_hz": counts,
    "drop": st.floats(0, 1),
    "model": words,
    "perception": st.floats(0, 1).map(lambda least: GroundTruthPerception(contrast_min=least)),
    "files": digests,
    "time_of_day_min": st.integers(0, 1439),
    "weather": words,
    "objects": st.dictionaries(words, st.just(ObjectVariation()), max_size=2),
    "repeat": counts,
    "batch": counts,
    "drive": keeps,
    "formula": words,
    "origin": words.map(lambda word: CaseOrigin(campaign=word, case=word)),
    "forks": words.map(lambda word: [Fork(case=word)]),
    "tell": st.lists(st.sampled_from(["case", "seed", "truth"]), unique=True),
}


unhurried = settings(deadline=None, max_examples=40)


def _plain() -> Case:
    """A case of the least campaign."""
    campaign, mistakes = parse_campaign({"campaign": "c", "matrix": {"weather": ["clear"]}})
    assert campaign is not None, mistakes
    return expand(campaign)[0]


PLAIN = _plain()


def test_every_field_is_tried() -> None:
    assert {*RIG} == {*RigSpec.__struct_fields__} - {"files"}
    assert {*VARIATION} == {*Variation.__struct_fields__}


@pytest.mark.parametrize("field", RIG)
@unhurried
@given(data=st.data())
def test_another_rig_has_another_key(field: str, data: st.DataObject) -> None:
    one, other = (changed(PLAIN, **{field: data.draw(RIG[field])}) for _ in range(2))
    same = structs.asdict(one.rig)[field] == structs.asdict(other.rig)[field]
    assert (rig_key(one) == rig_key(other)) == same


@pytest.mark.parametrize("field", VARIATION)
@unhurried
@given(data=st.data())
def test_another_variation_has_the_same_key(field: str, data: st.DataObject) -> None:
    case = PLAIN
    variation = structs.replace(case.variation, **{field: data.draw(VARIATION[field])})
    assert rig_key(Case(rig=case.rig, variation=variation)) == rig_key(case)


@unhurried
@given(path=words, elsewhere=words, sha=words, other=words)
def test_files_count_by_their_contents(path: str, elsewhere: str, sha: str, other: str) -> None:
    rigs = [
        structs.replace(PLAIN.rig, scene=place, files={place: content})
        for place, content in ((path, sha), (elsewhere, sha), (path, other))
    ]
    keys = [rig_key(Case(rig=rig, variation=PLAIN.variation)) for rig in rigs]
    assert keys[0] == keys[1]
    assert (keys[0] == keys[2]) == (sha == other)
