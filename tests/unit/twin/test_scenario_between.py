"""``between`` looks at two targets, in the simulator and again from its files."""

import numpy as np
import pytest

from schemas.kinds.scenario import kind_of
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.kpi import verdict
from twin.kpi.judge import TableRows
from twin.kpi.judge_record import hit_of, state_of, surroundings_of
from twin.records.kpi_file import kpi_table
from twin.rig.engine import Engine
from twin.road.lane import straight
from twin.scenario.between.family import Between
from twin.scenario.families import replay
from twin.scenario.surroundings import Surroundings

CAMPAIGN = {
    "campaign": "between",
    "camera": {"width": 32, "height": 18, "hz": 10},
    "scenario": {"type": "between", "ego_speed_mps": 10.0, "duration_s": 6.0},
    "autonomy": {"stack": "devkit.idle:IdleStack"},
    "matrix": {"scenario.approach_m": [1.0, 20.0]},
}


def test_a_stop_between_passes_and_one_before_does_not():
    campaign, mistakes = parse_campaign(CAMPAIGN)
    assert campaign is not None, mistakes
    cases = expand(campaign)
    engine, ended = Engine(cases[0], 2), {}
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    while engine.active.any():
        engine.sense()
        brakes = [Command(slot, 0, int(engine.tick[slot]), 0.0, 0.8, 0.0) for slot in range(2)]
        running = zip(brakes, engine.active, strict=True)
        for end in engine.step([command if on else None for command, on in running]):
            ended[end.slot] = end
    assert [ended[slot].verdict for slot in range(2)] == ["pass", "too_near"]
    for end in ended.values():
        rows = TableRows(kpi_table(end.table.to_lists()))
        ground = surroundings_of(end.record)
        assert len(ground.further) == 1
        again = replay(end.record.scenario, ground, rows)
        kinds = kind_of(end.record.scenario).scalars
        state, hit = state_of(end.record), hit_of(end.record)
        assert verdict.judge(rows, state, again, hit).verdict == end.verdict
        assert verdict.scalars(rows, state, again, hit, kinds) == end.scalars


def test_both_targets_must_stand_in_the_scene():
    campaign, mistakes = parse_campaign(CAMPAIGN)
    assert campaign is not None, mistakes
    config = kind_of(campaign.scenario).config_of(campaign.scenario)
    ground = Surroundings(straight(0.0, 100.0), np.zeros(5), 1.4, 2.4, 0.9, (None,))
    with pytest.raises(ValueError, match="needs obstacle, not in this scene"):
        Between.start(config, ground)
