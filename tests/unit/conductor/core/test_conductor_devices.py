"""Workers of several device classes: which campaigns they share, and what results are called."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from conductor_bench import Bench, hello, result, submit

from conductor.core.facts import Committed, Pinned
from conductor.records.outcomes import Outcomes, encode_campaign, outcomes_of

CPU, GPU, ARM = "cpu:x86_64+avx2+fma", "cuda:NVIDIA H200", "cpu:aarch64"
PORTABLE: dict[str, Any] = {
    "stack_identity": {"portable": True},
    "autonomy": {"perception": {"truth": {"type": "ground_truth"}}},
}
NETWORK = PORTABLE | {"autonomy": {"perception": {"n": {"type": "network", "model": "x.onnx"}}}}


def workers(campaign: dict[str, Any], *classes: str) -> Bench:
    bench = Bench()
    assert not bench.ask(submit(cases=4, **campaign)).error
    for number, name in enumerate(classes, 1):
        assert not bench.ask(hello(f"w{number}", device_class=name)).error
    return bench


@pytest.mark.parametrize("first", [CPU, GPU])
@pytest.mark.parametrize("restarted", [False, True])
def test_a_cpu_and_a_gpu_share_a_portable_campaign(first: str, restarted: bool) -> None:
    bench = workers(PORTABLE, first, GPU if first == CPU else CPU)
    leases = bench.lease("w1", k=2)
    if restarted:
        bench.restart()
    others = bench.lease("w2", k=2)
    assert (len(leases), len(others)) == (2, 2)
    assert [fact.device_class for fact in bench.facts(Pinned)] == ["portable"]
    assert bench.status()["campaigns"]["alpha"]["device_class"] == "portable"
    bench.next("w1", k=0, results=[result(lease) for lease in leases])
    bench.next("w2", k=0, results=[result(lease) for lease in others])
    # The journal keeps which machine it was; what the results depend on is the same.
    assert {fact.device_class for fact in bench.facts(Committed)} == {CPU, GPU}
    made = outcomes_of(bench.state.campaigns["alpha"])
    assert {case.device_class for case in made.cases.values()} == {"portable"}
    assert (made.device_classes, made.machines) == (["portable"], [CPU, GPU])
    written = bytes(encode_campaign(bench.state.campaigns["alpha"]))
    assert msgspec.json.decode(written, type=Outcomes) == made


@pytest.mark.parametrize(
    ("campaign", "classes"),
    [
        (NETWORK, (CPU, GPU)),
        (NETWORK, (GPU, CPU)),
        (PORTABLE | {"stack_identity": {}}, (CPU, GPU)),
        (PORTABLE, (CPU, ARM)),
        (PORTABLE, (ARM, CPU)),
    ],
)
def test_others_are_refused_a_campaign_that_is_not(
    campaign: dict[str, Any], classes: tuple[str, str]
) -> None:
    bench = workers(campaign, *classes)
    leases = bench.lease("w1", k=1)
    assert bench.lease("w2") == []
    (note,) = bench.status()["notes"]
    assert "w2: device class" in note
    assert "that campaign 'alpha' began with; it gets no case of it" in note
    bench.next("w1", k=0, results=[result(lease) for lease in leases])
    made = outcomes_of(bench.state.campaigns["alpha"])
    mine = "portable" if (campaign, classes[0]) == (PORTABLE, CPU) else classes[0]
    assert (made.device_classes, made.ran_on) == ([mine], [classes[0]])


def test_a_result_that_differs_between_them_is_a_disagreement() -> None:
    """A stack that says that it is portable and is not: two attempts of a case tell."""
    bench = workers(PORTABLE, CPU, GPU)
    (lost,) = bench.lease("w1", k=1)
    bench.now_ns += 10**12
    bench.tick()
    again = next(lease for lease in bench.lease("w2", k=4) if lease.case.id == lost.case.id)
    bench.next("w2", k=0, results=[result(again)])
    bench.next("w1", k=0, results=[result(lost, kpi="other")])
    assert bench.status()["campaigns"]["alpha"]["disagreements"] == 1


def test_a_campaign_that_takes_any_device_is_mixed_only_if_its_results_may_differ() -> None:
    for campaign, classes in ((PORTABLE, ["portable", ARM]), (NETWORK, [ARM, GPU])):
        bench = workers(campaign | {"device": "any"}, GPU, ARM)
        for worker in ("w1", "w2"):
            leases = bench.lease(worker, k=2)
            bench.next(worker, k=0, results=[result(lease) for lease in leases])
        made = outcomes_of(bench.state.campaigns["alpha"])
        assert (made.device_classes, made.ran_on) == (sorted(classes), [ARM, GPU])
