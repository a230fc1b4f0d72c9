"""Multilevel splitting on the real vehicle: a car that nobody steers, in gusts across the road."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from case_changes import changed
from msgspec import UNSET

from conductor.search.driver import Closed, first, follow
from conductor.search.intervals import wilson
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.messages import Command
from schemas.plan import expand, plan_of
from schemas.searching.search_points import with_forks
from twin.rig.engine import Engine

SLOTS = 40
LIMIT_M = 0.7
"""The car is seldom blown that far in the time of a case."""


def _campaign() -> Campaign:
    data = {
        "campaign": "gusts",
        "seed": 3,
        "control_hz": 10,
        "render": False,
        "environment": {"custom": {"gale": {"wind": 1.0}}},
        "scenario": {
            "type": "lane_keeping",
            "ego_speed_mps": 22.0,
            "duration_s": 4.0,
            "lateral_limit_m": 3.0,
            "distance_m": 200.0,
        },
        "autonomy": {"stack": "devkit.idle:IdleStack"},
        "matrix": {"weather": ["gale"]},
        "search": {
            "parameters": {},
            "objective": {"kpi": "lateral_error_max_m", "fails_above": LIMIT_M},
            "sampler": "splitting",
            "options": {"particles": 30, "runs": 8},
            "budget": {"cases": 3000},
            "proposed": [[[]]],
        },
    }
    return msgspec.convert(data, Campaign)


def _errors(engine: Engine, cases: list[Case]) -> list[float | None]:
    """Largest lateral errors of cases that run hands off."""
    waiting = list(enumerate(cases))
    running: dict[int, int] = {}
    errors: list[float | None] = [None] * len(cases)
    while waiting or running:
        for slot in range(SLOTS):
            if waiting and not engine.active[slot]:
                running[slot], case = waiting.pop()
                engine.reset(slot, case)
        engine.sense()
        commands = [
            Command(slot, 0, int(engine.tick[slot]), 0.0, 0.0, 0.0) if slot in running else None
            for slot in range(SLOTS)
        ]
        for ended in engine.step(commands):
            value = ended.scalars["lateral_error_max_m"]
            errors[running.pop(ended.slot)] = None if value is None else float(value)
    return errors


@pytest.mark.slow
def test_splitting_and_monte_carlo_agree_on_how_often_a_gust_blows_a_car_away() -> None:
    campaign = _campaign()
    search = campaign.search
    assert search is not UNSET
    [base] = expand(campaign)
    engine = Engine(base, SLOTS)
    plain = _errors(engine, [changed(base, id=f"plain-{index}") for index in range(500)])
    hits = sum(error is not None and error > LIMIT_M for error in plain)
    low, high = wilson(hits, len(plain))
    assert 2 < hits < 100, np.quantile(plain, [0.1, 0.5, 0.9, 0.95, 0.98, 0.99, 1.0])

    proposal = first(search, "gusts", 3)
    search = msgspec.structs.replace(search, proposed=[])
    u, results = [], []
    while proposal is not None:
        number = len(u)
        u.append(proposal.u)
        search = msgspec.structs.replace(search, proposed=[*search.proposed, proposal.values])
        if proposal.forks:
            forks = with_forks(search, number, proposal.forks)
            search = msgspec.structs.replace(search, forks=forks)
        plan = plan_of(msgspec.structs.replace(campaign, search=search))
        results.append(_errors(engine, plan.cases[-len(proposal.u) :]))
        step = follow(search, "gusts", 3, Closed(u, results))
        proposal = step.proposal
    answer = step.answer
    assert answer.low is not None
    assert answer.high is not None
    assert max(low, answer.low) < min(high, answer.high), (hits, answer)
    assert answer.high < 40 * answer.low
    engine.close()
