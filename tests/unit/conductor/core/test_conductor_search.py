"""Searches in the conductor's core: the same trace whatever the order, the crew and the crashes."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import msgspec
import pytest
from conductor_bench import CONFIG, Bench, hello, result
from msgspec import UNSET
from search_bench import KPI, Crew, Unchecked, measured, plane, searched, section, submission, trace

from conductor.commands.tables import search_line
from conductor.core.facts import Generation, Image, Leased, Snapshot
from conductor.core.fold import apply, fold, revive
from conductor.core.invariants import check
from conductor.core.searching import growth
from conductor.core.snapshot import take
from conductor.core.state import Config
from conductor.journal.store import Journal
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION as V
from schemas.files.proposals import FILE_NAME
from schemas.files.yaml_file import dump_yaml, parse_yaml
from schemas.identity import campaign_digest, case_digest
from schemas.plan import parse_plan
from schemas.wire.control import StatusRequest, Submit
from twin.records.campaign_file import read_plan

SUBSET = {"level": 24, "share": 0.25}


def _sections() -> list[dict]:
    rare = {"kpi": KPI, "fails_below": -1.0}
    return [
        section("bayesian", objective={"kpi": KPI, "goal": "least"}),
        section("boundary", budget={"cases": 40}, options={"grid": 4}),
        section(),
        section("latin_hypercube"),
        section("sobol", budget={"generation": 8}),
        section("cma_es", objective={"kpi": KPI, "goal": "least"}),
        section("importance", budget={"cases": 80, "generation": 20}),
        section("subset", budget={"cases": 100}, options=SUBSET, objective=rare),
        section(chains=3, budget={"cases": 90}),
        section("sobol", chains=3, budget={"cases": 80, "generation": 8}),
        section(
            "cma_es",
            chains=4,
            budget={"cases": 100, "generation": 5},
            objective={"kpi": KPI, "goal": "least"},
        ),
        section("importance", chains=2, budget={"cases": 240, "generation": 20}),
        section("subset", chains=3, budget={"cases": 300}, options=SUBSET, objective=rare),
    ]


def _name(search: dict) -> str:
    return f"{search['sampler']}-{search.get('chains', 1)}"


@pytest.mark.parametrize("search", _sections(), ids=_name)
def test_crews_of_any_size_leave_the_same_trace(search: dict) -> None:
    alone = searched(search)
    for workers, slots, seed in ((4, 1, 1), (16, 4, 3), (64, 1, 5)):
        assert trace(searched(search, workers=workers, slots=slots, seed=seed).state) == trace(
            alone.state
        )
    record = alone.state.campaigns["searched"].search
    assert record is not None
    assert record.ended
    assert len(record.answers) == len(record.u) > 1
    chains = search.get("chains", 1)
    assert record.chains[:chains] == list(range(chains))
    assert record.answers[-1].cases == sum(record.sizes) <= search["budget"]["cases"]


def test_a_generation_of_another_chain_is_worked_on_while_one_waits() -> None:
    """The slowest case of a chain holds back its own generations, and those that come after."""
    bench = Bench()
    bench.ask(submission(section(chains=3, budget={"cases": 60, "generation": 4})))
    bench.ask(hello(slots=64))
    slow, *others = bench.lease(k=12)
    assert slow.case.id == "g0000-0000"
    bench.next(k=0, results=[measured(lease, plane) for lease in others], held=[slow.token])
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert (len(record.results), record.open) == (0, 3)
    reply = bench.next(k=64, results=[measured(slow, plane)])
    assert (len(record.results), record.open) == (3, 3)
    assert [record.chains[3:], record.sizes[3:]] == [[0, 1, 2], [4, 4, 4]]
    assert [lease.case.id for lease in reply.leases[::4]] == [
        "g0003-0000",
        "g0004-0000",
        "g0005-0000",
    ]


def test_what_is_under_way_when_a_search_ends_counts() -> None:
    """Where it ends is decided by the generations before, not by which cases were first."""
    search = section(chains=4, budget={"cases": 4000, "generation": 25, "half_width": 0.04})
    one, many = searched(search), searched(search, workers=32, slots=2, seed=4)
    assert trace(one.state) == trace(many.state)
    record = one.state.campaigns["searched"].search
    assert record is not None
    assert record.ended == "the interval asked for is reached"
    last = record.reasons.index(record.ended)
    assert len(record.results) == last + 4
    assert record.answers[-1].cases == record.answers[last].cases + 75
    whole = searched(section(chains=1, budget={"cases": 4000, "generation": 25}))
    first = whole.state.campaigns["searched"].search
    assert first is not None
    assert first.u[0] == record.u[0]
    assert record.u[1] not in first.u


def test_a_chain_that_ends_leaves_the_others_alone() -> None:
    """Subset simulation without an interval is one run, and runs have different lengths."""
    rare = {"kpi": KPI, "fails_below": -1.0}
    search = section("subset", chains=3, budget={"cases": 900}, options=SUBSET, objective=rare)
    record = searched(search).state.campaigns["searched"].search
    assert record is not None
    assert record.ended == "the sampler has its answer"
    counts = [record.chains.count(chain) for chain in range(3)]
    assert len(set(counts)) > 1
    answer = record.answers[-1]
    assert answer.method.startswith("mean of 3 chains, ")
    assert answer.probability is not None
    assert record.answers[min(counts)].probability is None


def test_a_case_that_is_retried_after_the_end_goes_on_in_all_chains() -> None:
    search = section(chains=3, budget={"cases": 36, "generation": 4})
    whole = trace(searched(search).state)
    bench = Bench()
    bench.ask(submission(search))
    bench.ask(hello(slots=64))
    one, *others = bench.lease(k=12)
    bench.control("cancel", campaign="searched", case=one.case.id)
    record = bench.state.campaigns["searched"].search
    assert record is not None
    bench.next(k=0, results=[measured(lease, plane) for lease in others])
    assert record.ended == "a case of its latest generation was cancelled"
    assert (len(record.results), bench.state.left, bench.state.searches) == (3, 0, {})
    bench.control("retry", campaign="searched", case=others[-1].case.id)
    assert record.open == 0, "it has an outcome"
    bench.control("retry", campaign="searched", case=one.case.id)
    assert (record.open, record.ended) == (3, "")
    Crew(bench, 2, 3, 1).work()
    assert trace(bench.state) == whole


def test_results_in_the_order_of_arrival_would_be_noticed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A planted mistake: history in the order in which results came."""
    search = section("cma_es", objective={"kpi": KPI, "goal": "least"})
    arrived: list[str] = []

    def in_order_of_arrival(lease, form):  # type: ignore[no-untyped-def]
        arrived.append(lease.case.id)
        return measured(lease, form)

    real = growth.next_generation

    def planted(campaign, cpu):  # type: ignore[no-untyped-def]
        count = len(campaign.search.u[-1])
        latest = campaign.ordered[-count:]
        by_arrival = sorted(latest, key=lambda case: arrived.index(case.case.id))
        campaign.ordered[-count:] = by_arrival
        try:
            return real(campaign, cpu)
        finally:
            campaign.ordered[-count:] = latest

    monkeypatch.setattr("search_bench.measured", in_order_of_arrival)
    monkeypatch.setattr(growth, "next_generation", planted)
    one = trace(searched(search, workers=4, slots=3, seed=1).state)
    arrived.clear()
    assert trace(searched(search, workers=4, slots=3, seed=2).state) != one


@pytest.mark.parametrize("chains", [1, 2])
def test_a_restart_at_any_moment_changes_nothing(chains: int) -> None:
    search = section(
        "cma_es", chains=chains, budget={"cases": 60}, objective={"kpi": KPI, "goal": "least"}
    )
    whole = trace(searched(search, workers=3, slots=2).state)
    bench = Bench()
    bench.ask(submission(search))
    for number in range(1, 13):
        requests = [0]

        def tired(limit: int = number, requests: list[int] = requests) -> bool:
            requests[0] += 1
            return requests[0] > limit

        Crew(bench, 3, 2, number).work(tired)
        bench.restart()
        bench.now_ns += CONFIG.ttl_ns + 1
    bench.tick()
    Crew(bench, 3, 2, 99).work()
    assert trace(bench.state) == whole


def test_proposals_are_on_disk_before_a_lease_and_are_read_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = searched(section(), workers=3, slots=2)
    known: set[str] = set()
    for fact in bench.journal:
        if isinstance(fact, Generation):
            known |= {f"g{fact.number:04d}-{i:04d}" for i in range(len(fact.u))}
        if isinstance(fact, Leased) and not fact.case.startswith("g0000"):
            assert fact.case in known

    def never(*_: object) -> None:
        raise AssertionError("proposed again")

    monkeypatch.setattr("conductor.search.driver.follow", never)
    assert trace(fold(bench.journal, CONFIG)) == trace(bench.state)


@pytest.mark.parametrize("chains", [1, 3])
def test_a_snapshot_holds_the_search(monkeypatch: pytest.MonkeyPatch, chains: int) -> None:
    """Cases that came later are in images of their own, and full ones are taken once."""
    monkeypatch.setattr("conductor.core.snapshot.IMAGE_CASES", 8)
    monkeypatch.setattr("conductor.core.searching.images.IMAGE_CASES", 8)
    monkeypatch.setattr("conductor.core.fold.IMAGE_CASES", 8)
    bench = Unchecked()
    bench.ask(submission(section(chains=chains, budget={"cases": 240})))
    images: dict[str, Image] = {}
    for cases in (10, 60, 100, 110, 240):
        known = set(images)
        bench.now_ns += CONFIG.ttl_ns + 1
        bench.tick()
        crew = Crew(bench, 2, 2, cases)
        crew.work(lambda cases=cases: bench.state.campaigns["searched"].search.closed >= cases)
        taken = take(bench.state)
        apply(bench.state, taken)
        images |= {image.key: image for image in taken.images}
        again = known & {image.key for image in taken.images if image.key.startswith("1/0000")}
        assert len(again) <= 2, "the campaign, and the image that was not full"
        state = fold([Snapshot(images=list(images.values()))], Config(folder="/state"))
        check(state)
        assert trace(state) == trace(bench.state)
        assert state.searches == bench.state.searches
        assert state.campaigns["searched"].digest == bench.state.campaigns["searched"].digest
        assert state.campaigns["searched"].imaged == len(bench.state.campaigns["searched"].ordered)
        bench.state = state  # a restart goes on from there
        revive(state, bench.now_ns)
    assert sum(key.startswith("1/000000/") for key in images) == (240 - 10 * chains) // 8 + 1
    assert not bench.state.left


def test_the_journal_takes_generations(tmp_path) -> None:  # type: ignore[no-untyped-def]
    bench = searched(section())
    journal = Journal(tmp_path)
    journal.append(bench.journal)
    assert trace(fold(journal.fold(), CONFIG)) == trace(bench.state)
    journal.close()


def test_the_same_campaign_again_is_a_resume() -> None:
    bench = searched(section())
    assert bench.ask(submission(section())).status["resumed"]
    other = bench.ask(submission(section(budget={"cases": 31})))
    assert "other cases" in other.error


def test_a_search_ends_when_its_interval_is_reached() -> None:
    bench = searched(section(budget={"cases": 5000, "generation": 100, "half_width": 0.04}))
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert record.ended == "the interval asked for is reached"
    answer = record.answers[-1]
    assert answer.high is not None
    assert answer.low is not None
    assert (answer.high - answer.low) / 2 <= 0.04
    assert answer.low <= 0.0668 <= answer.high


def test_a_missing_kpi_ends_a_search_in_one_line_and_a_retry_goes_on() -> None:
    bench = Bench()
    bench.ask(submission(section(budget={"cases": 4, "generation": 2})))
    bench.ask(hello())
    one, two = bench.lease(k=2)
    bench.next(results=[measured(one, plane)])
    bench.control("cancel", campaign="searched", case=two.case.id)
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert record.ended == "a case of its latest generation was cancelled"
    bench.control("retry", campaign="searched", case=two.case.id)
    assert not record.ended
    (again,) = bench.lease(k=1)
    bench.next(k=0, results=[result(again)])
    assert record.ended.startswith(f"{two.case.id} has no {KPI}; ")
    assert bench.state.left == 0


@pytest.mark.parametrize(("missing", "failures"), [("fails", 2), ("holds", 0)])
def test_a_missing_kpi_counts_as_the_campaign_says(missing: str, failures: int) -> None:
    objective = {"kpi": KPI, "fails_below": -50.0, "missing": missing}
    bench = Bench()
    bench.ask(submission(section(budget={"cases": 4, "generation": 2}, objective=objective)))
    bench.ask(hello())
    leases = bench.lease(k=2)
    bench.next(k=0, results=[result(lease) for lease in leases])
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert (record.answers[0].failures, record.answers[0].missing) == (failures, 2)
    assert not record.ended


def test_a_sampler_that_fails_ends_its_search(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("a bug\nof somebody")

    monkeypatch.setattr("conductor.search.driver.follow", broken)
    bench = searched(section())
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert record.ended.startswith("its sampler failed: RuntimeError: a bug")
    assert "\n" not in record.ended


@pytest.mark.parametrize(
    ("sampler", "library"), [("monte_carlo", ""), ("cma_es", "cma"), ("bayesian", "scikit-learn")]
)
def test_versions_are_those_of_the_samplers_libraries(sampler: str, library: str) -> None:
    """Whatever else the process has loaded: the trace has them."""
    importlib.import_module("sklearn")
    bench = searched(section(sampler, budget={"cases": 20, "generation": 10}))
    record = bench.state.campaigns["searched"].search
    assert record is not None
    assert {*record.versions} == {"numpy", "scipy", library} - {""}


def test_a_search_without_its_first_generation_is_refused() -> None:
    request = submission(section())
    bare = {**request.campaign, "search": section()}
    reply = Bench().ask(msgspec.structs.replace(request, campaign=bare))
    assert "a search begins with one" in reply.error


def test_a_conductor_without_the_libraries_refuses_a_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whoever submits it has them; here no generation but the first could be proposed."""
    request = submission(section())
    monkeypatch.setitem(sys.modules, "conductor.search.driver", None)
    reply = Bench().ask(request)
    assert "where the conductor runs, a search needs further libraries (" in reply.error
    assert reply.error.endswith("; pip install 'drivetwin[search]'")


@pytest.mark.parametrize("chains", [1, 3])
def test_the_campaign_file_gives_the_digest_and_every_case_by_name(chains: int) -> None:
    bench = searched(section(chains=chains, budget={"cases": 90}))
    state = bench.state.campaigns["searched"]
    text = dump_yaml(msgspec.to_builtins(state.campaign))
    plan, mistakes = parse_plan(parse_yaml(text, "campaign.yaml"))
    assert not mistakes
    assert plan is not None
    assert campaign_digest(plan.campaign, plan.cases) == state.digest
    assert plan.cases == [case.case for case in state.ordered]
    alone = plan.only("g0002-0003")
    assert alone is not None
    again, _ = parse_plan(msgspec.to_builtins(alone.campaign))
    assert again is not None
    assert [case.id for case in again.cases] == ["g0002-0003"]
    assert case_digest(again.cases[0]) == case_digest(state.cases["g0002-0003"].case)
    fresh = Bench()
    content = {**msgspec.to_builtins(alone.campaign), "campaign": "again"}
    assert not fresh.ask(Submit(v=V, campaign=content)).error
    assert fresh.state.campaigns["again"].search is None
    assert fresh.state.left == 1


def test_the_folder_of_a_run_has_every_case_by_name(tmp_path: Path) -> None:
    """Values lie beside the campaign file, which is small however many there are."""
    bench = searched(section(chains=3, budget={"cases": 90}), out=str(tmp_path))
    state = bench.state.campaigns["searched"]
    folders = Folders(tmp_path)
    folders.record(state)
    folders.flush()
    assert len((tmp_path / FILE_NAME).read_text().splitlines()) == 9
    assert "proposed:\n    generations: 9\n" in (tmp_path / "campaign.yaml").read_text()
    plan = read_plan(tmp_path / "campaign.yaml")
    assert campaign_digest(plan.campaign, plan.cases) == state.digest
    assert plan.cases == [case.case for case in state.ordered]
    alone = plan.only("g0007-0003")
    assert alone is not None
    assert alone.campaign.search is not UNSET
    assert [len(rows) > 0 for rows in alone.campaign.search.proposed] == [i == 7 for i in range(9)]
    again, mistakes = parse_plan(msgspec.to_builtins(alone.campaign))
    assert again is not None, mistakes
    assert case_digest(again.cases[0]) == case_digest(state.cases["g0007-0003"].case)


def test_a_file_with_many_generations_does_not_begin_a_search() -> None:
    state = searched(section()).state.campaigns["searched"]
    content = {**msgspec.to_builtins(state.campaign), "campaign": "again"}
    assert "3 generations given, a search begins with one" in (
        Bench().ask(Submit(v=V, campaign=content)).error
    )


def test_a_status_tells_generation_best_and_interval() -> None:
    row = searched(section()).ask(StatusRequest(v=V)).status["campaigns"]["searched"]
    found = row["search"]
    assert found["generation"] == 3
    assert found["budget"] == 30
    assert found["low"] <= found["probability"] <= found["high"]
    assert found["best_case"] in found["answer"]
    line = search_line(row)
    assert line.startswith("3 generations closed, 30 of at most 30 cases; probability of failure ")
    assert line.endswith("the budget of 30 cases is spent")
