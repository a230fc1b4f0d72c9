"""Whatever is wrong with a search is one line: what was given, what is allowed."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from search_bench import KPI, NAMES, section

from conductor.run.source import load
from conductor.search.driver import first
from schemas.plan import examine
from schemas.sections.search import Search
from schemas.validation import convert_all
from twin.base.errors import UsageError

ONE = NAMES[0]
NORMAL = {"distribution": "normal", "mean": 0.0, "sd": 1.0}
INFINITE, NO_NUMBER = math.inf, math.nan
AXIS = f"search.parameters.{ONE}"
EXTREME = {"kpi": KPI, "goal": "least"}


def _told(search: Any) -> list[str]:
    data = {"campaign": "searched", "matrix": {"weather": ["clear"]}, "search": search}
    return [mistake.line("f") for mistake in examine(data)[1]]


def _without(key: str) -> dict[str, Any]:
    return {name: value for name, value in section().items() if name != key}


def _drawn(**distribution: Any) -> dict[str, Any]:
    return section(parameters={ONE: distribution})


def _between(*names: str, rho: Any = 0.5) -> dict[str, Any]:
    return section(correlations=[{"between": list(names), "rho": rho}])


SECTIONS = (
    (None, "search: given nothing, expected a mapping with keys parameters"),
    ([], "search: given [], expected a mapping"),
    ("monte_carlo", "search: given 'monte_carlo', expected a mapping"),
    (_without("objective"), "search.objective: missing; a mapping needed"),
    (_without("budget"), "search.budget: missing; a mapping needed"),
    (_without("parameters"), "search.parameters: missing; a mapping needed"),
    (section(budgets={}), "search.budgets: unknown key; did you mean 'budget'? allowed: "),
    (section(parameters={}), "search.parameters: "),
    (
        section(parameters={f"objects.o{i}.start_s": NORMAL for i in range(41)}),
        "search.parameters: given 41 names, at most 40 allowed",
    ),
    (section(first=[[NO_NUMBER, 0.0]]), "search.first[0][0]: given nan, allowed: a number, finite"),
)
BUDGETS = (
    ({**section(), "budget": {}}, "budget.cases: missing; a whole number >= 1 and <= "),
    *(
        (section(budget={"cases": given}), f"budget.cases: given {shown}, allowed: a whole number")
        for given, shown in (
            *((0, "0"), (-1, "-1"), (1.5, "1.5"), (10**9, "1000000000"), ("many", "'many'")),
            *((NO_NUMBER, "nan"), (INFINITE, "inf"), (None, "nothing")),
        )
    ),
    *(
        (section(budget={key: given}), f"budget.{key}: given {given}, allowed: a number > 0")
        for key in ("half_width", "relative_half_width")
        for given in (0, -0.1, NO_NUMBER, INFINITE)
    ),
    (section(budget={"half_width": 2}), "half_width: given 2, allowed: at most 0.5, all there is"),
    (section(budget={"generation": 0}), "budget.generation: given 0, allowed: a whole number >= 1"),
    (
        section("cma_es", objective=EXTREME, budget={"generation": 1}),
        "budget.generation: given 1, sampler cma_es needs at least 2",
    ),
    (
        section("importance", budget={"generation": 10}),
        "budget.generation: given 10, sampler importance needs at least 20",
    ),
)
DISTRIBUTIONS = (
    (section(parameters={ONE: None}), f"{AXIS}: given nothing, allowed: a mapping"),
    (section(parameters={ONE: 3}), f"{AXIS}: given 3, allowed: a mapping"),
    (_drawn(low=0, high=1), f"{AXIS}.distribution: given nothing, allowed: uniform, normal"),
    (_drawn(distribution="gauss"), f"{AXIS}.distribution: given 'gauss', allowed: uniform"),
    *(
        (_drawn(distribution="uniform", **given), f"{AXIS}.{line}")
        for given, line in (
            ({"low": 0}, "high: missing; a number needed"),
            ({"low": NO_NUMBER, "high": 1}, "low: given nan, allowed: a number, finite"),
            ({"low": 0, "high": INFINITE}, "high: given inf, allowed: a number, finite"),
            ({"low": "a", "high": 1}, "low: given 'a', allowed: a number"),
            ({"low": 0, "high": 1, "mid": 0}, "mid: unknown key; allowed: low, high, whole"),
        )
    ),
    (_drawn(distribution="uniform", low=1, high=1), f"{AXIS}: low 1 is not below high 1"),
    (
        _drawn(distribution="uniform", low=0.1, high=0.4, whole=True),
        f"{AXIS}: can have one value only; an axis with one value belongs into the matrix",
    ),
    (_drawn(distribution="choices", values=[1.0]), f"{AXIS}: can have one value only"),
    (
        _drawn(distribution="choices", values=[1.0, 2.0], weights=[0, 1]),
        f"{AXIS}: can have one value only",
    ),
    *(
        (_drawn(distribution="normal", **{"mean": 0, "sd": 1, key: given}), f"{AXIS}.{key}: given")
        for key, given in (
            *(("sd", 0), ("sd", -1), ("sd", NO_NUMBER), ("sd", INFINITE)),
            *(("mean", NO_NUMBER), ("mean", -INFINITE)),
        )
    ),
    (_drawn(distribution="lognormal", median=0, sigma=1), f"{AXIS}.median: given 0, allowed: a nu"),
    (_drawn(distribution="lognormal", median=1, sigma=9), f"{AXIS}: given 1.85867"),
    (_drawn(distribution="exponential", mean=-1), f"{AXIS}.mean: given -1, allowed: a number > 0"),
    (_drawn(distribution="exponential", mean=500), f"{AXIS}: given 17500.0, allowed: a number >="),
    (_drawn(distribution="triangular", low=0, mode=5, high=1), f"{AXIS}: low, mode and high do no"),
    (_drawn(distribution="integers", low=0, high=1.5), f"{AXIS}.high: given 1.5, allowed: a whole"),
    (_drawn(distribution="integers", low=0, high=10**30), f"{AXIS}: given 1000000000000000000"),
    (_drawn(distribution="choices", values=[]), f"{AXIS}.values: given an empty list, at least 1"),
    (_drawn(distribution="choices", values=[NO_NUMBER, 1.0]), f"{AXIS}.values[0]: given nan, allo"),
    *(
        (_drawn(distribution="choices", values=[1, 2], weights=[1, given]), f"{AXIS}.weights[1]: g")
        for given in (-1, NO_NUMBER, INFINITE, "much")
    ),
    (_drawn(distribution="choices", values=[1, 2], weights=[0, 0]), f"{AXIS}: the weights are all"),
    (
        section(
            parameters={"autonomy.latency_ms": {"distribution": "uniform", "low": 0, "high": 9}}
        ),
        "autonomy.latency_ms: given 0.0, allowed: a whole number >= 0",
    ),
    (section(parameters={"hour": NORMAL}), "search.parameters.hour: unknown axis; allowed: model"),
)
CORRELATIONS = (
    *(
        (_between(*NAMES, rho=given), f"search.correlations[0].rho: given {given}, allowed: a numb")
        for given in (1, -1, 2.5, NO_NUMBER, INFINITE)
    ),
    (_between(ONE, ONE), "search.correlations[0].between: 1 parameters given, 2 are needed"),
    (_between(ONE, "objects.b.start_s"), "correlations[0].between: no parameter 'objects.b.start"),
    (
        section(correlations=[{"between": [*NAMES][:: 1 - 2 * i], "rho": 0.1} for i in range(2)]),
        "search.correlations[1].between: this pair appears twice; name it once",
    ),
)
OBJECTIVES = (
    (section(objective={"fails_below": 0}), "search.objective"),
    (section(objective={"kpi": 3, "fails_below": 0}), "search.objective.kpi: given 3, allowed: te"),
    (section(objective={"kpi": KPI}), "objective: 0 of them given; give one of fails_below, fails"),
    *(
        (section(objective={"kpi": KPI, key: given}), f"search.objective.{key}: given {given}, all")
        for key in ("fails_below", "fails_above")
        for given in (NO_NUMBER, INFINITE, -INFINITE)
    ),
    (section(objective={"kpi": KPI, "goal": "max"}), "objective.goal: given 'max', allowed: least"),
    (
        section(objective={"kpi": KPI, "fails_below": 0, "missing": "skip"}),
        "objective.missing: given 'skip', allowed: ends, fails, holds",
    ),
    *(
        (
            section(sampler, objective=EXTREME, budget={"generation": 64}),
            f"search.objective.goal: sampler {sampler} gives a probability; say fails_below or fai",
        )
        for sampler in ("monte_carlo", "latin_hypercube", "sobol", "importance", "subset")
    ),
)
SAMPLERS = (
    (section("montecarlo"), "search.sampler: no 'montecarlo'; there: monte_carlo, latin_hypercube"),
    (section("subset", options={"levle": 3}), "options.levle: unknown key; did you mean 'level'?"),
    (section("subset", options={"keep": 1.0}), "options.keep: given 1.0, allowed: a number >= 0 a"),
    (section("subset", options={"keep": NO_NUMBER}), "search.options.keep: given nan, allowed: "),
    (section(options={"level": 100}), "search.options: unknown key 'level'; there is none"),
    (section(options=None), "search.options: given nothing, expected a mapping of names to values"),
    (
        section("cma_es", objective=EXTREME, parameters={ONE: NORMAL}),
        "search.parameters: 1 given, sampler cma_es needs 2",
    ),
    (
        section("cma_es", objective=EXTREME, budget={"relative_half_width": 0.1}),
        "search.budget: sampler cma_es gives no interval; remove half_width",
    ),
)


@pytest.mark.parametrize(
    ("search", "line"),
    [*SECTIONS, *BUDGETS, *DISTRIBUTIONS, *CORRELATIONS, *OBJECTIVES, *SAMPLERS],
)
def test_a_broken_search_is_one_line_that_says_what_is_allowed(search: Any, line: str) -> None:
    told = _told(search)
    assert len(told) == 1, told
    assert line in told[0]
    assert "\n" not in told[0]


@pytest.mark.parametrize(
    ("search", "line"),
    [
        (section("subset", budget={"cases": 100}), "100 cases are too few for one generation of s"),
        (
            section("cma_es", objective=EXTREME, budget={"cases": 4, "generation": 8}),
            "4 cases are too few for one generation of cma_es",
        ),
    ],
)
def test_a_budget_below_one_generation_is_told(search: dict[str, Any], line: str) -> None:
    section_, mistakes = convert_all(search, Search)
    assert section_ is not None, mistakes
    with pytest.raises(ValueError, match=line):
        first(section_, "searched", 1)


FILE = """
campaign: rain
matrix: {weather: [heavy_rain]}
autonomy: {perception: {eyes: {type: ground_truth}}}
search:
  parameters: {PARAMETER}
  objective: {kpi: dtc_min_m, fails_below: 0.5}
  budget: {cases: 4}
"""
LATENCY = "{autonomy.latency_ms: {distribution: integers, low: 0, high: 400}}"


WITHOUT = """
import sys

sys.modules[sys.argv[1]] = None
from conductor.cli import main

sys.argv = ["conductor", "validate", sys.argv[2]]
main()
"""


def test_a_parameter_that_no_case_uses_is_told(tmp_path: Path) -> None:
    path = tmp_path / "rain.yaml"
    nobody = "{objects.nobody.start_s: {distribution: normal, mean: 0, sd: 1}}"
    path.write_text(FILE.replace("{PARAMETER}", nobody))
    with pytest.raises(UsageError) as told:
        load(str(path))
    assert "objects.nobody: the scene has no object of this name; allowed: " in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("library", ["scipy", "threadpoolctl"])
def test_a_library_that_is_missing_is_told(library: str, tmp_path: Path) -> None:
    path = tmp_path / "rain.yaml"
    path.write_text(FILE.replace("{PARAMETER}", LATENCY))
    command = [sys.executable, "-c", WITHOUT, library, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "search: a search needs further libraries" in done.stderr
    assert "pip install 'drivetwin[search]'" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
