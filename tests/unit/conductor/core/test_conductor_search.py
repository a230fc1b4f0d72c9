"""Searches in the conductor's core: the same trace whatever the order, the crew and the crashes."""

from __future__ import annotations

import msgspec
import pytest
from conductor_bench import CONFIG, Bench, hello, result
from search_bench import KPI, Crew, measured, plane, searched, section, submission, trace

from conductor.commands.tables import search_line
from conductor.core.facts import Generation, Leased, Snapshot
from conductor.core.fold import fold
from conductor.core.invariants import check
from conductor.core.searching import growth
from conductor.core.snapshot import take
from conductor.core.state import Config
from conductor.journal.store import Journal
from schemas import SCHEMA_VERSION as V
from schemas.files.yaml_file import dump_yaml, parse_yaml
from schemas.identity import campaign_digest, case_digest
from schemas.plan import parse_plan
from schemas.wire.control import StatusRequest, Submit

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
    ]


@pytest.mark.parametrize("search", _sections(), ids=lambda search: search["sampler"])
def test_crews_of_any_size_leave_the_same_trace(search: dict) -> None:
    alone = searched(search)
    for workers, slots, seed in ((4, 1, 1), (16, 4, 3)):
        assert trace(searched(search, workers=workers, slots=slots, seed=seed).state) == trace(
            alone.state
        )
    record = alone.state.campaigns["searched"].search
    assert record is not None
    assert record.ended
    assert len(record.answers) == len(record.u) > 1


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


def test_a_restart_at_any_moment_changes_nothing() -> None:
    search = section("cma_es", objective={"kpi": KPI, "goal": "least"})
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


def test_a_snapshot_holds_the_search() -> None:
    bench = Bench()
    bench.ask(submission(section()))
    taken = [take(bench.state)]
    Crew(bench, 2, 2, 1).work(lambda: len(bench.state.campaigns["searched"].ordered) > 15)
    taken.append(take(bench.state))
    images = {image.key: image for snapshot in taken for image in snapshot.images}
    state = fold([Snapshot(images=list(images.values()))], Config(folder="/state"))
    check(state)
    assert trace(state) == trace(bench.state)
    assert state.searches == bench.state.searches
    assert state.campaigns["searched"].digest == bench.state.campaigns["searched"].digest


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


def test_a_search_without_its_first_generation_is_refused() -> None:
    request = submission(section())
    bare = {**request.campaign, "search": section()}
    reply = Bench().ask(msgspec.structs.replace(request, campaign=bare))
    assert "a search begins with one" in reply.error


def test_the_campaign_file_gives_the_digest_and_every_case_by_name() -> None:
    bench = searched(section())
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
