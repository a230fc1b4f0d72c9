"""The longest cases begin first: by an earlier run, by a pilot, by what this run has learned."""

from __future__ import annotations

import heapq
from dataclasses import replace
from typing import Any

import pytest
from conductor_bench import Bench, ended, hello, result

from conductor.core.case_table import pack
from conductor.core.durations import PILOT_SHARE, VALUES_MAX, CaseLengths
from conductor.core.state import Config
from conductor.run.places import gpu_slots
from schemas import SCHEMA_VERSION as V
from schemas.case import Case
from schemas.plan import parse_plan
from schemas.wire.control import Share, Submit

MODELS = ["slow", "quick", "blind", "sharp"]
WEATHERS = ["clear", "heavy_fog", "heavy_rain", "heavy_snow"]
HOURS = ["05:00", "09:00", "13:00", "21:00"]
CONFIG = Config(folder="/state")


def family(name: str = "alpha", **changed: Any) -> dict[str, Any]:
    """A campaign of 64 cases: four models, weathers and hours."""
    perception = {model: {"type": "ground_truth"} for model in MODELS}
    matrix = {"model": MODELS, "weather": WEATHERS, "time_of_day": HOURS}
    data = {"campaign": name, "autonomy": {"perception": perception}, "matrix": matrix}
    return data | changed


def cases_of(data: dict[str, Any]) -> list[Case]:
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    return list(plan.cases)


def length_s(case: Case) -> float:
    """How long a case is: by its model, weather and hour, and a little of its own."""
    name = case.id
    by_model = dict(zip(MODELS, (9.0, 1.0, 14.0, 3.0), strict=True))
    model = next(model for model in MODELS if name.startswith(model))
    fog = 5.0 if "fog" in name else 2.0 if "snow" in name else 0.0
    return by_model[model] + fog + 3.0 * name.count("2100") + 0.01 * (len(name) % 7)


def lengths_of(cases: list[Case], before: dict[str, float] | None = None) -> CaseLengths:
    return CaseLengths.of_table(pack(cases), [case.id for case in cases], before or {})


def slot_use(config: Config, slots: int, data: dict[str, Any] | None = None) -> float:
    """Share of the slots of one worker that have a case, from the first lease to the last end."""
    bench = Bench(config)
    bench.ask(Submit(v=V, campaign=data or family()))
    bench.ask(hello(slots=slots))
    running = [(length_s(lease.case), lease.token, lease) for lease in bench.lease(k=slots)]
    heapq.heapify(running)
    busy_s = end_s = 0.0
    while running:
        end_s, _, lease = heapq.heappop(running)
        busy_s += length_s(lease.case)
        scalars = {"sim_time_s": length_s(lease.case)}
        held = [other for _, other, _ in running]
        done = [result(lease, scalars=scalars)]
        for more in bench.lease(k=1, results=done, held=held):
            heapq.heappush(running, (end_s + length_s(more.case), more.token, more))
    assert not bench.state.left
    return busy_s / (slots * end_s)


def use_of_workers(config: Config, workers: int, slots: int) -> tuple[float, float]:
    """Share of the slots of several workers of one GPU that have a case until their last one ends,
    and when the last of all ends [s]."""
    bench = Bench(config)
    bench.ask(Submit(v=V, campaign=family()))
    names = [f"w{number}" for number in range(workers)]
    held: dict[str, list[int]] = {name: [] for name in names}
    running: list[tuple[float, int, str, Any]] = []

    def begin(name: str, now_s: float, **fields: Any) -> None:
        for lease in bench.lease(name, k=slots - len(held[name]), held=held[name], **fields):
            held[name].append(lease.token)
            heapq.heappush(running, (now_s + length_s(lease.case), lease.token, name, lease))

    for number, name in enumerate(names):
        bench.ask(hello(name, slots=slots, share=Share(number, workers, 0, 1)))
    for name in names:
        begin(name, 0.0)
    busy_s, ends_s = 0.0, dict.fromkeys(names, 0.0)
    while running:
        now_s, token, name, lease = heapq.heappop(running)
        busy_s, ends_s[name] = busy_s + length_s(lease.case), now_s
        held[name].remove(token)
        done = [result(lease, scalars={"sim_time_s": length_s(lease.case)})]
        begin(name, now_s, results=done)
    assert not bench.state.left
    return busy_s / (slots * sum(ends_s.values())), max(ends_s.values())


def test_with_an_earlier_run_fewer_slots_end_as_early():
    """All cases at once leave most slots empty at last, in whatever order they began."""
    before = {case.id: length_s(case) for case in cases_of(family())}
    config = replace(CONFIG, lengths_s=before)
    at_once, fewer = gpu_slots(64, 4, None), gpu_slots(64, 4, None, list(before.values()))
    assert (at_once, fewer) == (16, 9)
    used, end_s = use_of_workers(config, 4, at_once)
    assert used == use_of_workers(CONFIG, 4, at_once)[0] < 0.65
    used_now, end_now_s = use_of_workers(config, 4, fewer)
    assert used_now > used + 0.1
    assert end_now_s == end_s == max(before.values())


def test_a_pilot_has_every_value_and_few_cases():
    cases = cases_of(family())
    pilot = lengths_of(cases).pilot
    assert len(pilot) == 4
    assert pilot == sorted(pilot)
    chosen = [cases[position].id for position in pilot]
    for value in (*MODELS, *WEATHERS, *(hour.replace(":", "") for hour in HOURS)):
        assert any(value in name for name in chosen), (value, chosen)


def test_a_pilot_that_would_be_much_of_the_campaign_is_none():
    data = family(matrix={"model": MODELS, "weather": WEATHERS[: PILOT_SHARE - 1]})
    lengths = lengths_of(cases_of(data))
    assert (lengths.pilot, lengths.enough) == ([], 4)


def test_columns_without_a_choice_are_no_axes():
    repeats = list(range(VALUES_MAX + 1))
    many = {"campaign": "alpha", "matrix": {"repeat": repeats, "weather": WEATHERS}}
    assert len(lengths_of(cases_of(many)).axes) == 1
    alone = {"campaign": "alpha", "matrix": {"repeat": [0]}}
    lengths = lengths_of(cases_of(alone))
    assert (lengths.axes, lengths.pilot, lengths.told) == ([], [], False)


def test_an_earlier_run_tells_cases_without_axes_apart():
    repeats = list(range(VALUES_MAX + 1))
    data = {"campaign": "alpha", "matrix": {"repeat": repeats}}
    names = [case.id for case in cases_of(data)]
    before = {name: float(k % 7) for k, name in enumerate(names)}
    lengths = lengths_of(cases_of(data), before)
    assert (lengths.axes, lengths.told) == ([], True)
    assert not lengths_of(cases_of(data), {"of another campaign": 3.0, "and another": 1.0}).told
    bench = Bench(replace(CONFIG, lengths_s=before))
    bench.ask(Submit(v=V, campaign=data))
    bench.ask(hello())
    leased = [before[lease.case.id] for lease in bench.lease(k=12)]
    assert leased == sorted(before.values(), reverse=True)[:12]


def test_the_longest_case_that_its_worker_may_not_have_leaves_it_the_others():
    """Its last attempt is for another worker; a charged case is in no lane with others."""
    cases = cases_of(family())
    before = {case.id: length_s(case) for case in cases}
    longest, *others = sorted(before, key=lambda name: -before[name])
    bench = Bench(replace(CONFIG, lengths_s=before))
    bench.ask(Submit(v=V, campaign=family(attempts_max=2)))
    bench.ask(hello())
    bench.ask(hello("w2"))
    (lease,) = bench.lease(k=1)
    assert lease.case.id == longest
    bench.next(k=0, ended=[ended(lease, "crash")])
    assert [lease.case.id for lease in bench.lease(k=3)] == others[:3]


def test_lengths_are_estimated_by_the_values_of_axes():
    cases = cases_of(family())
    lengths = lengths_of(cases)
    assert not lengths.told
    for position in range(0, 64, 3):
        lengths.add(position, length_s(cases[position]))
    assert lengths.told
    unknown = [position for position in range(64) if position % 3]
    errors = [abs(lengths.expected_s(k) - length_s(cases[k])) for k in unknown]
    assert max(errors) < 3.0
    assert sum(errors) / len(errors) < 1.2
    assert lengths.expected_s(0) == length_s(cases[0]), "a measured one is as measured"


def test_estimates_are_the_same_whatever_was_asked_before():
    cases = cases_of(family())
    one, other = lengths_of(cases), lengths_of(cases)
    for position in range(16):
        one.add(position, length_s(cases[position]))
        other.add(position, length_s(cases[position]))
    asked = [one.expected_s(position) for position in range(64)]
    assert [other.expected_s(position) for position in reversed(range(64))] == asked[::-1]


def test_with_an_earlier_run_the_longest_begin_first():
    cases = cases_of(family())
    before = {case.id: length_s(case) for case in cases}
    bench = Bench(replace(CONFIG, lengths_s=before))
    bench.ask(Submit(v=V, campaign=family()))
    bench.ask(hello())
    leased = [before[lease.case.id] for lease in bench.lease(k=20)]
    assert leased == sorted(before.values(), reverse=True)[:20]


def test_of_a_share_its_longest_begin_first():
    cases = cases_of(family())
    before = {case.id: length_s(case) for case in cases}
    bench = Bench(replace(CONFIG, lengths_s=before))
    bench.ask(Submit(v=V, campaign=family()))
    bench.ask(hello(share=Share(1, 4, 0, 1)))
    leased = [lease.case.id for lease in bench.lease(k=8)]
    own = [case.id for case in cases[16:32]]
    assert leased == sorted(own, key=lambda name: -before[name])[:8]


def test_a_campaign_learns_from_one_of_the_same_axes_in_the_journal():
    bench = Bench(CONFIG)
    bench.ask(Submit(v=V, campaign=family()))
    bench.ask(hello())
    leases = bench.lease(k=64)
    bench.lease(k=0, results=[result(x, scalars={"sim_time_s": length_s(x.case)}) for x in leases])
    for name, changed in (("again", {"seed": 5}), ("other", {"scenario": {"duration_s": 9}})):
        bench.ask(Submit(v=V, campaign=family(name, **changed)))
    learned = bench.state.campaigns["again"].lengths
    cases = cases_of(family())
    assert [learned.expected_s(k) for k in range(64)] == [length_s(case) for case in cases]
    assert not bench.state.campaigns["other"].lengths.known


@pytest.mark.parametrize(
    "config", [replace(CONFIG, by_batch=True), replace(CONFIG, longest_first=False)]
)
def test_batches_and_who_does_not_want_it_keep_the_order(config):
    cases = cases_of(family())
    config = replace(config, lengths_s={case.id: length_s(case) for case in cases})
    bench = Bench(config)
    bench.ask(Submit(v=V, campaign=family()))
    bench.ask(hello())
    assert [lease.case.id for lease in bench.lease(k=9)] == [case.id for case in cases[:9]]


def test_slots_are_used_more_with_an_earlier_run_and_with_a_pilot():
    known = {case.id: length_s(case) for case in cases_of(family())}
    in_order = slot_use(replace(CONFIG, longest_first=False), 16)
    piloted = slot_use(CONFIG, 16)
    informed = slot_use(replace(CONFIG, lengths_s=known), 16)
    print(f"slots used: {in_order:.0%} in order, {piloted:.0%} with a pilot, {informed:.0%} known")
    assert informed > 0.95
    assert piloted > in_order
    assert informed > in_order + 0.05


def test_results_without_a_length_teach_nothing():
    bench = Bench(CONFIG)
    bench.ask(Submit(v=V, campaign=family()))
    bench.ask(hello())
    leases = bench.lease(k=8)
    bench.lease(k=0, results=[result(lease) for lease in leases[:4]])
    bench.lease(k=0, results=[result(x, scalars={"sim_time_s": None}) for x in leases[4:]])
    assert not bench.state.campaigns["alpha"].lengths.known
