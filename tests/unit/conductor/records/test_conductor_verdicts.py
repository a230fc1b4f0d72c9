"""What counts as passed: one rule for counts, sentences, outcomes and exit codes, whatever the
journals and files of earlier versions say."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from conductor_bench import Bench, hello, result, started, submit
from prometheus_client.core import GaugeMetricFamily

from conductor.core.status import status
from conductor.records.outcomes import CaseOutcome, Outcomes, exit_code, outcomes_of
from conductor.serve.metrics import ConductorCollector
from schemas.verdict import is_pass, no_collision
from schemas.wire.bounds import Token
from schemas.wire.control import Result
from schemas.wire.view import CaseEnd, Thumbnail

DATA = Path(__file__).parents[1] / "data"
EVERY = ("pass", "collision", "false_braking", "time_up", "lane_departure")


@pytest.mark.parametrize("outcome", ["verdict", "failed", "unresolved", "cancelled", ""])
@pytest.mark.parametrize("verdict", [*EVERY, "nan", ""])
def test_only_the_verdict_pass_is_a_pass(outcome: str, verdict: str) -> None:
    assert is_pass(outcome, verdict) == ((outcome, verdict) == ("verdict", "pass"))
    expected = verdict != "collision" if outcome == "verdict" else None
    assert no_collision(outcome, verdict) is expected


@pytest.mark.parametrize("outcome", ["verdict", "failed", ""])
@pytest.mark.parametrize(
    ("verdict", "passes"),
    [
        *(("avoided", True), ("mitigated", False), ("not_mitigated", False), ("fail", False)),
        *(("inconclusive", False), ("false_reaction", False)),
    ],
)
def test_of_the_words_of_trials_one_passes(outcome: str, verdict: str, passes: bool) -> None:
    assert is_pass(outcome, verdict) == (outcome == "verdict" and passes)
    scalars = {"impact_speed_mps": 3.0, "trial_speed_mps": 9.0}
    decided = outcome == "verdict"
    assert no_collision(outcome, verdict, scalars) is (False if decided else None)
    scalars["impact_speed_mps"] = None
    assert no_collision(outcome, verdict, scalars) is (True if decided else None)


@pytest.mark.parametrize("type_", [Result, CaseOutcome, CaseEnd, Thumbnail])
@pytest.mark.parametrize("said", [True, False])
@pytest.mark.parametrize("verdict", EVERY)
def test_what_is_written_beside_the_verdict_has_no_say(
    type_: type, said: bool, verdict: str
) -> None:
    names = {"": "", "outcome": "verdict", "verdict": verdict, "passed": said}
    kinds = {int: 0, Token: 0, str: "", float: 0.0, bool: False, float | None: None}
    fields = {
        field.encode_name: names.get(field.name, kinds.get(field.type, []))
        for field in msgspec.structs.fields(type_)
        if field.required or field.name in names
    }
    if "scalars" in fields:
        fields["scalars"] = {}
    found = msgspec.convert(fields, type_)
    assert found.passed == (verdict == "pass")
    assert msgspec.structs.replace(found, verdict="pass").passed
    assert msgspec.json.decode(msgspec.json.encode(found))["passed"] == (verdict == "pass")


def test_metrics_count_verdicts_that_are_a_pass() -> None:
    bench = started(cases=2)
    leases = bench.lease("w1", k=2)
    bench.next("w1", k=0, results=[result(leases[0]), result(leases[1], verdict="time_up")])
    found = {**status(bench.state, bench.now_ns), "counters": {}}
    metric = next(iter(ConductorCollector(lambda: found).collect()))
    assert isinstance(metric, GaugeMetricFamily)
    values = {sample.labels["state"]: sample.value for sample in metric.samples}
    assert (values["passed"], values["not_passed"]) == (1, 1)


def _outcomes(*ends: tuple[str, str]) -> Outcomes:
    bench = Bench()
    bench.ask(submit(cases=1))
    bench.ask(hello("w1"))
    made = outcomes_of(bench.state.campaigns["alpha"])
    cases = {f"c{n}": CaseOutcome(outcome=o, verdict=v) for n, (o, v) in enumerate(ends)}
    return msgspec.structs.replace(made, cases=cases)


@pytest.mark.parametrize(
    ("ends", "code"),
    [
        ([("verdict", "pass"), ("verdict", "pass")], 0),
        ([("verdict", "pass"), ("verdict", "false_braking")], 1),
        ([("verdict", "pass"), ("verdict", "time_up")], 1),
        ([("verdict", "pass"), ("failed", "")], 1),
        ([("verdict", "pass"), ("cancelled", "")], 1),
        ([("verdict", "collision"), ("unresolved", "")], 3),
        ([("verdict", "collision"), ("unresolved", ""), ("", "")], 75),
    ],
)
def test_exit_codes_follow_the_verdicts(ends: list[tuple[str, str]], code: int) -> None:
    assert _outcomes(*ends).exit_code == code


def test_nothing_submitted_is_nothing_lost() -> None:
    assert exit_code(cases=0, passed=0, unresolved=0, left=0) == 0
