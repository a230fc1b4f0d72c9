"""Multilevel splitting: answers on walks of known probability, lineages, and broken sections."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from conductor_bench import result
from msgspec import UNSET
from search_bench import KPI, searched, section, trace
from walk_bench import solve_walks, truth, walk_section, walked

from schemas.campaign import Campaign
from schemas.files.yaml_file import dump_yaml, parse_yaml
from schemas.identity import campaign_digest, case_digest
from schemas.plan import examine, parse_plan
from schemas.searching.search_points import lineage
from schemas.sections.search import name_of, place_of
from schemas.wire.control import Lease, Result

SMALL = {"particles": 10, "runs": 4}
HEIGHT = 20


@pytest.mark.parametrize(("height", "shifted"), [(16, False), (26, False), (30, True)])
def test_a_walk_that_climbs_high_is_found_with_its_probability(height: int, shifted: bool) -> None:
    search = walk_section(5000, shifted=shifted)
    p = truth(height, shifted=shifted)
    for seed in range(3):
        answer, _ = solve_walks(search, seed, height)
        assert answer.probability is not None
        assert answer.low is not None
        assert answer.high is not None
        assert answer.low < p < answer.high
        assert answer.high < 8 * answer.low


def test_an_interval_that_is_asked_for_takes_as_many_batches_as_it_needs() -> None:
    budget = {"cases": 10_000, "relative_half_width": 0.2}
    answer, search = solve_walks(walk_section(1, budget=budget), 1, 16)
    assert answer.low is not None
    assert answer.high is not None
    assert answer.probability is not None
    assert answer.high - answer.low <= 0.4 * answer.probability
    assert search.forks is not UNSET
    begun = [rows for rows in search.forks if not rows]
    assert len(begun) >= 2, "a batch begins with cases that are no forks"


def test_where_nobody_comes_the_probability_is_bounded() -> None:
    answer, _ = solve_walks(walk_section(5000, options=SMALL), 1, 66)
    assert answer.probability == 0.0
    assert answer.low == 0.0
    assert answer.high is not None
    assert 0.0 < answer.high < 0.01


def test_lineages_begin_with_a_first_case_and_come_nearer_with_every_fork() -> None:
    _, search = solve_walks(walk_section(3000), 2, 26)
    assert search.forks is not UNSET
    deepest = 0
    for generation, rows in enumerate(search.forks):
        for number in range(len(rows)):
            name = name_of(generation, number)
            forks = lineage(search, name)
            assert forks is not UNSET
            assert place_of(forks[0].case)[0] == 0
            assert forks[-1].case == name
            assert not forks[0].column
            margins = [fork.margin for fork in forks[1:]]
            assert margins == sorted(set(margins), reverse=True)
            assert {(fork.column, fork.limit) for fork in forks[1:]} == {("dtc_m", 0.5)}
            deepest = max(deepest, len(forks))
    assert deepest > 4
    assert lineage(search, name_of(0, 3)) is UNSET


def _file(campaign: Campaign) -> Any:
    return parse_yaml(dump_yaml(msgspec.to_builtins(campaign)), "campaign.yaml")


def _branch(parent: str) -> dict[str, Any]:
    return {"parent": parent, "margin": 1.0}


def _measured(lease: Lease, _form: object) -> Result:
    """The result of a walk of the lease's lineage."""
    forks = lease.case.variation.forks
    least = walked(5, lease.case.id, [] if forks is UNSET else forks, 0, HEIGHT)
    return result(lease, scalars={KPI: least})


def _walks(**changes: Any) -> dict[str, Any]:
    search = section("splitting", parameters={}, options=SMALL, budget={"cases": 400}, **changes)
    return {**search, "objective": {"kpi": KPI, "fails_below": 0.5}}


def test_crews_of_any_size_fork_alike_and_a_run_s_file_has_the_same_cases(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("search_bench.measured", _measured)
    alone = searched(_walks())
    many = searched(_walks(), workers=8, slots=3, seed=2)
    assert trace(alone.state) == trace(many.state)
    assert b'"g0001-0000"' in trace(alone.state)
    known = alone.state.campaigns["searched"]
    assert known.campaign.search is not UNSET
    assert known.campaign.search.forks is not UNSET
    plan, mistakes = parse_plan(_file(known.campaign))
    assert plan is not None, mistakes
    assert campaign_digest(plan.campaign, plan.cases) == known.digest
    cases = [state.case for state in known.ordered]
    assert [case_digest(case) for case in plan.cases] == [case_digest(case) for case in cases]
    last = plan.only(cases[-1].id)
    assert last is not None
    again, mistakes = parse_plan(_file(last.campaign))
    assert again is not None, mistakes
    assert [case_digest(case) for case in again.cases] == [case_digest(cases[-1])]
    assert cases[-1].variation.forks is not UNSET


def _mistakes(search: dict[str, Any]) -> list[str]:
    data = {"campaign": "c", "matrix": {"weather": ["clear"]}, "search": search}
    _, mistakes = examine(data)
    return [mistake.line("c") for mistake in mistakes]


def test_what_cannot_split_is_one_line() -> None:
    assert not _mistakes(_walks())
    [line] = _mistakes({**_walks(), "objective": {"kpi": "aeb_time_s", "fails_above": 2.0}})
    assert "aeb_time_s is no extreme of a column; such are dtc_min_m" in line
    [line] = _mistakes({**_walks(), "objective": {"kpi": KPI, "fails_above": 2.0}})
    assert "needs fails_below" in line
    [line] = _mistakes({**_walks(), "sampler": "monte_carlo", "options": {}})
    assert "0 given, sampler monte_carlo needs 1" in line
    forks = {"proposed": [[[]], [[]]], "forks": [[], [_branch("g0000-0000")]]}
    assert not _mistakes({**_walks(), **forks})
    for wrong in ("g0001-0000", "g0000-0001", "g0-0", "x", "g0000--001"):
        [line] = _mistakes({**_walks(), **forks, "forks": [[], [_branch(wrong)]]})
        assert "is no case of an earlier generation" in line
    [line] = _mistakes({**_walks(), **forks, "forks": [[], [None, None]]})
    assert "2 forks for 1 cases" in line
    [line] = _mistakes({**section(), "forks": [[None]]})
    assert "proposes none" in line
