"""What a section ``search`` makes of a campaign: its points, and what is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
from msgspec import UNSET, UnsetType

from schemas.axes import axes_allowed, is_axis
from schemas.kinds.kpi import scalars_by_name
from schemas.kinds.registry import implementation
from schemas.kinds.sampler import sampler_kinds
from schemas.kinds.scenario import kind_of
from schemas.searching.search_limits import budget_mistakes, constant_problem
from schemas.sections.fork import Branch, Fork
from schemas.sections.scenario import Scenario
from schemas.sections.search import (
    Choices,
    Distribution,
    Exponential,
    Integers,
    LogNormal,
    Normal,
    Objective,
    Search,
    Triangular,
    TruncatedNormal,
    Uniform,
    Value,
    name_of,
    place_of,
    rows_of,
)
from schemas.validation import Mistake, convert_all, suggest

Z_MAX = 8.0
"""Standard deviations at which a parameter's normal variable is cut: one draw in 10^15."""
PIVOT_MIN = 1e-9
"""Smallest pivot of a correlation matrix that counts as positive definite."""
_NO_PARAMETERS = ("repeat",)
"""Axes that decide nothing but random numbers."""


def search_grid(
    search: Search, base: dict[str, list[Value]]
) -> Iterator[tuple[str, str, dict[str, Value]]]:
    """Where each proposed case stands in the file, its name, and its values."""
    fixed = {axis: values[0] for axis, values in base.items()}
    chosen = set(search.chosen)
    for generation, rows in enumerate(_proposed(search)):
        for number, row in enumerate(rows):
            name = name_of(generation, number)
            if chosen and name not in chosen:
                continue
            where = f"search.proposed[{generation}][{number}]"
            yield where, name, {**fixed, **dict(zip(search.parameters, row, strict=True))}


def proposed_count(search: Search) -> int:
    """Number of cases that are proposed so far."""
    return sum(map(len, _proposed(search)))


def _proposed(search: Search) -> Iterator[list[list[Value]]]:
    """The values of every generation; none of one that cannot be read, which is told elsewhere."""
    for rows in search.proposed:
        try:
            yield rows_of(rows)
        except ValueError:
            yield []


def probes(search: Search, base: dict[str, list[Value]]) -> Iterator[tuple[str, dict[str, Value]]]:
    """Points at the ends of every distribution, with where it stands; each must be allowed."""
    fixed = {axis: values[0] for axis, values in base.items()}
    middle = {axis: _ends(dist)[0] for axis, dist in search.parameters.items()}
    for axis, distribution in search.parameters.items():
        for end in _ends(distribution):
            yield f"search.parameters.{axis}", {**fixed, **middle, axis: end}


def _ends(distribution: Distribution) -> list[Value]:
    """The smallest and the largest value, or all that there are to choose from."""
    low: float
    match distribution:
        case Choices():
            return distribution.values
        case Integers():
            return [distribution.low, distribution.high]
        case Normal():
            low, high = (distribution.mean + s * Z_MAX * distribution.sd for s in (-1, 1))
        case LogNormal():
            reach = math.exp(min(Z_MAX * distribution.sigma, 700.0))
            low, high = distribution.median / reach, distribution.median * reach
        case Exponential():
            low, high = distribution.low, distribution.low + 35.0 * distribution.mean
        case _:
            low, high = distribution.low, distribution.high
    return [round(low), round(high)] if distribution.whole else [low, high]


def search_mistakes(
    search: Search,
    scenario: Scenario,
    matrix: dict[str, list[Value]],
    beside: dict[str, bool],
) -> list[Mistake]:
    """What is wrong with a section beside the types of its values.

    Args:
        search: the section.
        scenario: the campaign's.
        matrix: its axes, one value each.
        beside: keys of the campaign that a search excludes, and whether they are given.

    """
    mistakes = [
        Mistake(key, "a search proposes its cases itself; remove one of the two")
        for key, given in beside.items()
        if given
    ]
    for axis, values in matrix.items():
        if len(values) > 1:
            one = f"{len(values)} values; with a search, an axis has one"
            mistakes.append(Mistake(f"matrix.{axis}", one))
    mistakes += _parameter_mistakes(search, matrix)
    mistakes += _correlation_mistakes(search)
    mistakes += _objective_mistakes(search, scenario)
    mistakes += _sampler_mistakes(search)
    mistakes += _domain_mistakes(search)
    mistakes += _fork_mistakes(search) if not mistakes else []
    for generation, given in enumerate(search.proposed):
        where = f"search.proposed[{generation}]"
        try:
            rows = rows_of(given)
        except ValueError as error:
            return [*mistakes, Mistake(where, str(error))]
        for number, row in enumerate(rows):
            if len(row) != len(search.parameters):
                problem = f"{len(row)} values for {len(search.parameters)} parameters"
                return [*mistakes, Mistake(f"{where}[{number}]", problem)]
    if search.chosen and not {*_names(search)} & {*search.chosen}:
        mistakes.append(Mistake("search.chosen", "names no proposed case"))
    return mistakes


def _names(search: Search) -> Iterator[str]:
    for generation, rows in enumerate(_proposed(search)):
        yield from (name_of(generation, number) for number in range(len(rows)))


def _parameter_mistakes(search: Search, matrix: dict[str, list[Value]]) -> list[Mistake]:
    mistakes = []
    allowed = [axis for axis in axes_allowed() if axis not in _NO_PARAMETERS]
    for axis, distribution in search.parameters.items():
        where = f"search.parameters.{axis}"
        if axis in _NO_PARAMETERS or not is_axis(axis, allowed):
            mistakes.append(Mistake(where, f"unknown axis; {suggest(axis, allowed)}"))
        elif axis in matrix:
            mistakes.append(Mistake(where, "is an axis of the matrix as well; name it once"))
        if problem := _out_of_range(distribution):
            mistakes.append(Mistake(where, problem))
    kind = sampler_kinds().get(search.sampler)
    least = kind.generation_min if kind else 1
    return [*mistakes, *budget_mistakes(search.budget, search.sampler, least)]


def _out_of_range(distribution: Distribution) -> str:
    """What is wrong with the numbers of a distribution, or nothing."""
    match distribution:
        case Uniform() | Integers() | TruncatedNormal():
            if not distribution.low < distribution.high:
                return f"low {distribution.low:g} is not below high {distribution.high:g}"
        case Triangular():
            if not distribution.low <= distribution.mode <= distribution.high or not (
                distribution.low < distribution.high
            ):
                return "low, mode and high do not ascend"
        case Choices():
            if len({repr(value) for value in distribution.values}) != len(distribution.values):
                return "a value appears twice; list each once"
            if distribution.weights and len(distribution.weights) != len(distribution.values):
                count = len(distribution.weights)
                return f"{count} weights for {len(distribution.values)} values"
            if distribution.weights and not sum(distribution.weights) > 0:
                return "the weights are all 0"
    if isinstance(distribution, TruncatedNormal):
        nearest = min(max(distribution.mean, distribution.low), distribution.high)
        if abs(nearest - distribution.mean) > Z_MAX * distribution.sd:
            return f"its limits are more than {Z_MAX:g} standard deviations from the mean"
    return constant_problem(distribution)


def _correlation_mistakes(search: Search) -> list[Mistake]:
    mistakes = []
    pairs = set[tuple[str, ...]]()
    for index, correlation in enumerate(search.correlations):
        where = f"search.correlations[{index}].between"
        names = correlation.between
        unknown = [name for name in names if name not in search.parameters]
        if len(names) != 2 or len(set(names)) != 2:
            mistakes.append(Mistake(where, f"{len(set(names))} parameters given, 2 are needed"))
        elif unknown:
            hint = suggest(unknown[0], list(search.parameters))
            mistakes.append(Mistake(where, f"no parameter '{unknown[0]}'; {hint}"))
        elif tuple(sorted(names)) in pairs:
            mistakes.append(Mistake(where, "this pair appears twice; name it once"))
        pairs.add(tuple(sorted(names)))
    if not mistakes and _factor(correlation_matrix(search)) is None:
        problem = "no distribution has all of these at once; make them weaker"
        mistakes.append(Mistake("search.correlations", problem))
    return mistakes


def correlation_matrix(search: Search) -> list[list[float]]:
    """Correlations of the normal variables behind the parameters, in their order."""
    places = {axis: place for place, axis in enumerate(search.parameters)}
    matrix = [[float(i == j) for j in range(len(places))] for i in range(len(places))]
    for correlation in search.correlations:
        i, j = (places[axis] for axis in correlation.between)
        matrix[i][j] = matrix[j][i] = correlation.rho
    return matrix


def _factor(matrix: list[list[float]]) -> list[list[float]] | None:
    """The lower Cholesky factor; None: the matrix is not positive definite."""
    size = len(matrix)
    lower = [[0.0] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i][j] - sum(lower[i][k] * lower[j][k] for k in range(j))
            if i != j:
                lower[i][j] = rest / lower[j][j]
            elif rest < PIVOT_MIN:
                return None
            else:
                lower[i][i] = math.sqrt(rest)
    return lower


def correlation_factor(search: Search) -> list[list[float]]:
    """Lower Cholesky factor of :func:`correlation_matrix`, summed in a fixed order.

    Raises:
        AssertionError: the section has mistakes.
    """
    factor = _factor(correlation_matrix(search))
    assert factor is not None
    return factor


def _objective_mistakes(search: Search, scenario: Scenario) -> list[Mistake]:
    objective, kind = search.objective, kind_of(scenario)
    if objective.formula is not UNSET:
        from schemas.formulas.objective import formula_mistakes  # few campaigns need it

        return formula_mistakes(objective, objective.formula, kind)
    known = [scalar.name for scalar in kind.scalars if scalar.type != "name"]
    mistakes = []
    if not objective.kpi:
        return [Mistake("search.objective", "give kpi or formula")]
    if objective.kpi not in known:
        other = objective.kpi in scalars_by_name()
        why = f"scenario type {kind.name} does not give it" if other else "unknown"
        hint = suggest(objective.kpi, known)
        mistakes.append(Mistake("search.objective.kpi", f"'{objective.kpi}': {why}; {hint}"))
    told = [objective.fails_below is not UNSET, objective.fails_above is not UNSET]
    told.append(objective.goal is not UNSET)
    if sum(told) != 1:
        which = "give one of fails_below, fails_above and goal"
        mistakes.append(Mistake("search.objective", f"{sum(told)} of them given; {which}"))
    return mistakes


def _course_problem(objective: Objective) -> str:
    """Why cases cannot fork when their KPI reaches a value, or nothing."""
    scalar = scalars_by_name().get(objective.kpi)
    if scalar is None:
        return ""  # said where the KPI is looked at
    if scalar.course is None:
        courses = [name for name, kind in scalars_by_name().items() if kind.course is not None]
        return (
            f"forks cases on the way to their KPI, and {objective.kpi} is no extreme of a column; "
            f"such are {', '.join(courses)}"
        )
    if scalar.course.extreme == "least" and objective.fails_below is UNSET:
        return f"needs fails_below with {objective.kpi}, the least value of a case"
    if scalar.course.extreme == "most" and objective.fails_above is UNSET:
        return f"needs fails_above with {objective.kpi}, the greatest value of a case"
    return ""


def lineage(search: Search, name: str) -> list[Fork] | UnsetType:
    """Whose random numbers a proposed case has; unset: its own from start to end.

    A child's margin is smaller than its parent's, so its moments come in this order.
    """
    if search.forks is UNSET:
        return UNSET
    chain: list[tuple[str, Branch]] = []
    root = name
    while (branch := _branch(search.forks, root)) is not None:
        chain.append((root, branch))
        root = branch.parent
    if not chain:
        return UNSET
    scalar, objective = scalars_by_name()[search.objective.kpi], search.objective
    assert scalar.course is not None
    above = objective.fails_below is UNSET
    limit = objective.fails_above if above else objective.fails_below
    assert limit is not UNSET
    course = scalar.course
    waits = Fork(case=root, column=course.column, size=course.size, above=above, limit=limit)
    forks = [
        msgspec.structs.replace(waits, case=child, margin=branch.margin)
        for child, branch in reversed(chain)
    ]
    return [Fork(case=root), *forks]


def with_forks(
    search: Search, generation: int, forks: list[Branch | None]
) -> list[list[Branch | None]]:
    """The forks of a search with those of its next generation."""
    before = [] if search.forks is UNSET else search.forks
    gap: list[list[Branch | None]] = [[] for _ in range(generation - len(before))]
    return [*before, *gap, forks]


def _branch(forks: list[list[Branch | None]], name: str) -> Branch | None:
    generation, number = place_of(name)
    rows = forks[generation] if generation < len(forks) else []
    return rows[number] if number < len(rows) else None


def _fork_mistakes(search: Search) -> list[Mistake]:
    """What is wrong with forks, which a campaign file of a run lists."""
    forks = [] if search.forks is UNSET else search.forks
    if forks and not sampler_kinds().find(search.sampler).forks:
        return [Mistake("search.forks", f"sampler {search.sampler} proposes none; remove the key")]
    sizes = [len(rows) for rows in _proposed(search)]
    for generation, rows in enumerate(forks):
        where = f"search.forks[{generation}]"
        size = sizes[generation] if generation < len(sizes) else 0
        if len(rows) not in (0, size) and not search.chosen:
            return [Mistake(where, f"{len(rows)} forks for {size} cases")]
        for number, branch in enumerate(rows):
            if branch is not None and not _earlier(
                sizes[:generation], branch.parent, named=not search.chosen
            ):
                problem = f"'{branch.parent}' is no case of an earlier generation"
                return [Mistake(f"{where}[{number}]", problem)]
    return []


def _earlier(sizes: list[int], parent: str, *, named: bool) -> bool:
    """Whether a name is that of a case of generations with so many cases; not ``named``: whatever
    its number, since a file of chosen cases does not list all others."""
    try:
        generation, number = place_of(parent)
    except ValueError:
        return False
    return generation < len(sizes) and (number < sizes[generation] or not named)


def _sampler_mistakes(search: Search) -> list[Mistake]:
    try:
        kind = sampler_kinds().find(search.sampler)
    except ValueError as error:
        return [Mistake("search.sampler", str(error))]
    options, wrong = convert_all(search.options, kind.options)
    mistakes = [Mistake(f"search.options.{m.path}".rstrip("."), m.message) for m in wrong]
    objective, budget = search.objective, search.budget
    if search.chains > 1 and kind.chains == "none":
        alone = f"given {search.chains}, sampler {kind.name} has one chain"
        mistakes.append(Mistake("search.chains", alone))
    goes_on = objective.goal is not UNSET and objective.formula is UNSET
    if kind.gives != "extreme" and goes_on:
        answer = "indices of failures" if kind.gives == "indices" else f"a {kind.gives}"
        limit = f"sampler {kind.name} gives {answer}; say fails_below or fails_above"
        mistakes.append(Mistake("search.objective.goal", limit))
    if kind.forks and (problem := _course_problem(objective)):
        mistakes.append(Mistake("search.objective", f"sampler {kind.name} {problem}"))
    if len(search.parameters) < kind.parameters_min:
        least = f"{len(search.parameters)} given, sampler {kind.name} needs {kind.parameters_min}"
        mistakes.append(Mistake("search.parameters", least))
    if kind.gives == "indices" and search.correlations:
        apart = f"sampler {kind.name} needs independent parameters; remove them"
        mistakes.append(Mistake("search.correlations", apart))
    if budget.cases > kind.cases_max:
        most = f"given {budget.cases}, sampler {kind.name} takes at most {kind.cases_max}"
        mistakes.append(Mistake("search.budget.cases", most))
    if kind.checks and options is not None:
        mistakes += implementation(kind.checks)(search, options)
    if kind.gives != "probability" and not (
        budget.half_width is UNSET and budget.relative_half_width is UNSET
    ):
        no_interval = f"sampler {kind.name} gives no interval; remove half_width"
        mistakes.append(Mistake("search.budget", no_interval))
    return mistakes


def _domain_mistakes(search: Search) -> list[Mistake]:
    mistakes = []
    for axis, cells in ({} if search.domain is UNSET else search.domain).items():
        where = f"search.domain.{axis}"
        if axis not in search.parameters:
            hint = suggest(axis, list(search.parameters))
            mistakes.append(Mistake(where, f"no parameter '{axis}'; {hint}"))
        elif isinstance(search.parameters[axis], Choices):
            mistakes.append(Mistake(where, "each of its choices is a cell; remove it"))
        elif (cells.bins is UNSET) == (cells.edges is UNSET):
            mistakes.append(Mistake(where, "give one of bins and edges"))
        elif cells.edges is not UNSET and sorted(set(cells.edges)) != cells.edges:
            mistakes.append(Mistake(f"{where}.edges", "do not ascend"))
    return mistakes
