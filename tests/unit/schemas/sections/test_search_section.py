"""Every broken search is one clear line."""

from __future__ import annotations

from typing import Any

import pytest
from search_bench import KPI, NAMES, section

from schemas.plan import examine
from schemas.searching.search_points import correlation_factor, correlation_matrix
from schemas.sections.search import Search
from schemas.validation import convert_all

UNIFORM = {"distribution": "uniform", "low": 0.0, "high": 1.0}
ONE = NAMES[0]


def _told(search: dict[str, Any], **fields: Any) -> list[str]:
    data = {"campaign": "searched", "matrix": {"weather": ["clear"]}, "search": search, **fields}
    _, mistakes = examine(data)
    return [mistake.line("f") for mistake in mistakes]


def _parameter(axis: str = ONE, **distribution: Any) -> dict[str, Any]:
    return section(parameters={axis: distribution})


def _traced(**changes: Any) -> dict[str, Any]:
    return section("boundary", budget={"cases": 100}, **changes)


def test_a_good_one_has_no_mistake() -> None:
    assert _told(section()) == []


@pytest.mark.parametrize(
    ("search", "line"),
    [
        (section(budget={"cases": 0}), "budget.cases: given 0, allowed: a whole number >= 1"),
        (section(budget={"generation": 0}), "budget.generation: given 0, allowed"),
        (section(parameters={}), "search"),
        (section(objective={"kpi": KPI}), "objective: 0 of them given; give one of fails_below"),
        (
            section(objective={"kpi": KPI, "fails_below": 0, "fails_above": 1}),
            "objective: 2 of them given",
        ),
        (
            section(objective={"kpi": KPI, "fails_below": float("nan")}),
            "objective.fails_below: given nan, allowed: a number, finite",
        ),
        (
            section(objective={"kpi": "dtc", "fails_below": 0}),
            "objective.kpi: 'dtc': unknown; allowed: ",
        ),
        (
            section(objective={"kpi": "lane_departures", "fails_above": 0}),
            "objective.kpi: 'lane_departures': ",
        ),
        (section(objective={"missing": "fails"}), "objective: give kpi or formula"),
        (
            section(objective={"formula": "always (ttc > 1.0)"}),
            "objective.formula: no column 'ttc' of scenario type jump_scare; did you mean 'ttc_s'?",
        ),
        (section(objective={"formula": "always ttc_s"}), "objective.formula: 'ttc_s' has no bound"),
        (section(objective={"formula": "ttc_s >"}), "objective.formula: ends too early"),
        (
            section(objective={"formula": "hit_object > 1"}),
            "objective.formula: no column 'hit_object' of scenario type jump_scare",
        ),
        (
            section(objective={"formula": "ttc_s > 1", "kpi": KPI}),
            "objective.kpi: a formula is the objective; remove one of the two",
        ),
        (
            section(objective={"formula": "ttc_s > 1", "fails_below": 2.0}),
            "objective.fails_below: a formula is the objective; remove one of the two",
        ),
        (
            section(objective={"formula": "ttc_s > 1", "goal": "least"}),
            "objective.goal: a formula is the objective; remove one of the two",
        ),
        (
            section(objective={"kpi": KPI, "goal": "least"}),
            "objective.goal: sampler monte_carlo gives a probability; say fails_below",
        ),
        (
            section("sensitivity", objective={"kpi": KPI, "goal": "least"}),
            "objective.goal: sampler sensitivity gives indices of failures; say fails_below",
        ),
        (
            section("sensitivity", correlations=[{"between": list(NAMES), "rho": 0.5}]),
            "correlations: sampler sensitivity needs independent parameters; remove them",
        ),
        (section(domain={"x": {"bins": 3}}), "domain.x: no parameter 'x'; allowed: "),
        (section(domain={ONE: {}}), f"domain.{ONE}: give one of bins and edges"),
        (section(domain={ONE: {"bins": 1}}), f"domain.{ONE}.bins: given 1, allowed"),
        (section(domain={ONE: {"edges": [2, 1]}}), f"domain.{ONE}.edges: do not ascend"),
        (
            section(
                parameters={ONE: {"distribution": "choices", "values": [1, 2]}},
                domain={ONE: {"bins": 2}},
            ),
            f"domain.{ONE}: each of its choices is a cell; remove it",
        ),
        (_parameter("objects.a.colour", **UNIFORM), "objects.a.colour: unknown axis; "),
        (_parameter("weather", **UNIFORM), "parameters.weather: is an axis of the matrix as well"),
        (_parameter("repeat", **UNIFORM), "parameters.repeat: unknown axis"),
        (
            _parameter(distribution="uniform", low=2, high=1),
            f"parameters.{ONE}: low 2 is not below high 1",
        ),
        (_parameter(distribution="normal", mean=0, sd=0), "sd: given 0, allowed: a number > 0"),
        (_parameter(distribution="gauss", mean=0, sd=1), "distribution: given 'gauss', allowed: "),
        (
            _parameter(distribution="normal", mean=0, sd=1000),
            f"parameters.{ONE}: given -8000.0, allowed: a number >= -3600 and <= 3600",
        ),
        (
            _parameter(distribution="truncated_normal", mean=0, sd=1, low=50, high=60),
            "its limits are more than 8 standard deviations from the mean",
        ),
        (
            _parameter(distribution="triangular", low=0, mode=2, high=1),
            "low, mode and high do not ascend",
        ),
        (_parameter(distribution="choices", values=[1, 1]), "a value appears twice"),
        (
            _parameter(distribution="choices", values=[1, 2], weights=[1]),
            "1 weights for 2 values",
        ),
        (
            _parameter(distribution="choices", values=[1, 2], weights=[0, 0]),
            "the weights are all 0",
        ),
        (
            _parameter("sensors.gnss.noise_m", **UNIFORM),
            "search.parameters.sensors.gnss.noise_m",
        ),
        (
            section(correlations=[{"between": [ONE, "b"], "rho": 0.5}]),
            "correlations[0].between: no parameter 'b'",
        ),
        (
            section(correlations=[{"between": [ONE], "rho": 0.5}]),
            "correlations[0].between: 1 parameters given, 2 are needed",
        ),
        (
            section(correlations=[{"between": list(NAMES), "rho": 1.0}]),
            "correlations[0].rho: given 1.0, allowed: a number > -1 and < 1",
        ),
        (
            section(
                "cma_es",
                objective={"kpi": KPI, "goal": "least"},
                parameters={ONE: UNIFORM},
            ),
            "search.parameters: 1 given, sampler cma_es needs 2",
        ),
        (
            section("bayesian", budget={"cases": 501}),
            "budget.cases: given 501, sampler bayesian takes at most 500",
        ),
        (
            section("boundary", budget={"cases": 50}),
            "budget.cases: given 50, a grid of 8 cells per side takes 81, and its boundary more",
        ),
        (_traced(options={"x": "a"}), "options.x: no parameter 'a'; allowed: objects.a.start_s"),
        (_traced(options={"x": NAMES[1]}), "options.y: the same as x; name another parameter"),
        (_traced(options={"grid": 1}), "options.grid: given 1, allowed"),
        (_traced(options={"width": 0.0}), "options.width: given 0"),
        (
            _traced(correlations=[{"between": list(NAMES), "rho": 0.5}]),
            "correlations: a boundary is traced with all other parameters fixed; remove them",
        ),
        (
            _traced(
                parameters={ONE: UNIFORM, NAMES[1]: {"distribution": "choices", "values": [0, 1]}}
            ),
            f"options.y: '{NAMES[1]}' has choices, which have no order",
        ),
        (_traced(parameters={ONE: UNIFORM}), "parameters: 1 given, sampler boundary needs 2"),
        (
            _traced(objective={"kpi": KPI, "goal": "least"}),
            "objective.goal: sampler boundary gives a boundary; say fails_below or fails_above",
        ),
        (section("annealing"), "sampler: no 'annealing'; there: monte_carlo"),
        (section(proposed=["[[1"]), "search.proposed[0]: no rows of values: "),
        (section(chains=0), "search.chains: given 0, allowed: a whole number >= 1"),
        (section(chains=65), "search.chains: given 65, allowed: a whole number"),
        (section("subset", options={"level": 1}), "options.level: given 1, allowed"),
        (section("subset", options={"levels": 50}), "options.levels: unknown key"),
        (
            section("cma_es", objective={"kpi": KPI, "goal": "least"}, budget={"half_width": 0.1}),
            "budget: sampler cma_es gives no interval; remove half_width",
        ),
    ],
)
def test_a_broken_search_is_one_line(search: dict[str, Any], line: str) -> None:
    told = _told(search)
    assert len(told) == 1, told
    assert line in told[0]
    assert "\n" not in told[0]


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"simulator": "noop"}, "simulator: noop measures nothing that could be searched"),
        ({"matrix": {"weather": ["clear", "cloudy"]}}, "matrix.weather: 2 values; with a search"),
        ({"cases": [{"weather": "clear"}]}, "cases: a search proposes its cases itself"),
        ({"batch": {"size": 3}}, "batch: a search proposes its cases itself"),
    ],
)
def test_a_search_stands_alone(fields: dict[str, Any], line: str) -> None:
    told = _told(section(), **fields)
    assert len(told) == 1, told
    assert line in told[0]


def test_real_time_cannot_be_searched() -> None:
    assert any("realtime does not repeat" in line for line in _told(section(), clock="realtime"))


def test_correlations_that_contradict_each_other_are_told() -> None:
    names = ["objects.a.start_s", "objects.b.start_s", "objects.c.start_s"]
    pairs = [(0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9)]
    correlations = [{"between": [names[i], names[j]], "rho": rho} for i, j, rho in pairs]
    parameters = dict.fromkeys(names, UNIFORM)
    told = _told(section(parameters=parameters, correlations=correlations))
    assert told == [
        "f: search.correlations: no distribution has all of these at once; make them weaker"
    ]


def test_the_factor_gives_the_correlations() -> None:
    correlations = [{"between": list(NAMES), "rho": 0.5}]
    search, _ = convert_all(section(correlations=correlations), Search)
    assert search is not None
    factor, matrix = correlation_factor(search), correlation_matrix(search)
    for i, row in enumerate(matrix):
        for j, value in enumerate(row):
            assert sum(factor[i][k] * factor[j][k] for k in range(2)) == pytest.approx(value)
