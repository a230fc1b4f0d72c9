"""What the conductor makes of stacks and files that changed, and of files that were moved."""

from __future__ import annotations

from typing import Any

from conductor_bench import CONFIG, Bench, ended, hello, result, started, submit

from conductor.core.admit import admit
from conductor.core.facts import CaseEnded, Relocated, Snapshot
from conductor.core.fold import fold
from conductor.core.snapshot import take
from conductor.core.state import State
from schemas.identity import campaign_digest, case_digest, rig_key
from schemas.plan import expand, parse_campaign
from schemas.sections.stack_identity import StackIdentity
from schemas.wire.control import Reply

ONE = {"digest": "1" * 64, "parts": {"mine.py": "a" * 12, "near.py": "b" * 12}}
TWO = {"digest": "2" * 64, "parts": {"mine.py": "a" * 12, "near.py": "c" * 12}}


def placed(folder: str, content: str = "d" * 64) -> dict[str, Any]:
    """A campaign whose model, vehicle and further file lie in ``folder``."""
    model, vehicle = f"{folder}/net.onnx", f"{folder}/car.yaml"
    return {
        "scenario": {"vehicle": vehicle},
        "autonomy": {
            "files": [f"{folder}/map.json"],
            "perception": {"net": {"type": "network", "model": model}},
        },
        "files": {model: content, vehicle: "e" * 64},
        "stack_identity": ONE,
    }


def answered(bench: Bench, **fields: Any) -> Reply:
    """What a submission of the campaign is told."""
    return bench.ask(submit(**fields))


def test_another_stack_is_refused_also_when_all_cases_have_ended() -> None:
    bench = Bench()
    assert not answered(bench, cases=1, stack_identity=ONE, out="/state").error
    assert answered(bench, cases=1, stack_identity=ONE, out="/state").status["resumed"]
    bench.ask(hello())
    for _ in range(2):
        error = answered(bench, cases=1, stack_identity=TWO, out="/state").error
        assert "\n" not in error
        assert "another version of the stack: near.py has changed" in error
        assert f"stack digest {'1' * 12}, now {'2' * 12}" in error
        assert "give another folder with --out" in error
        (lease,) = bench.lease() or [None]
        if lease is not None:
            bench.next(k=0, results=[result(lease)])
    assert bench.state.left == 0


def test_a_conductor_that_serves_suggests_another_name() -> None:
    bench = Bench()
    answered(bench, stack_identity=ONE)
    assert "submit it under another name" in answered(bench, stack_identity=TWO).error


def test_a_shipped_stack_in_place_of_another_is_refused_as_well() -> None:
    bench = Bench()
    answered(bench, stack_identity=ONE)
    assert "another version of the stack" in answered(bench, stack_identity={}).error


def test_another_content_at_the_same_path_is_refused_by_name() -> None:
    bench = Bench()
    answered(bench, **placed("/a"))
    error = answered(bench, **placed("/a", "f" * 64)).error
    assert "/state/alpha was begun with another /a/net.onnx" in error


def test_a_campaign_of_an_older_version_is_refused_by_one_line() -> None:
    state = State(config=CONFIG)
    fact, _ = admit(state, submit())
    old = fold([type(fact)(**{**_fields(fact), "digest": "0" * 64, "digests": 0})], CONFIG)
    _, (line,) = admit(old, submit())
    assert "was begun by another version of drivetwin" in line


def _fields(fact: Any) -> dict[str, Any]:
    return {name: getattr(fact, name) for name in fact.__struct_fields__}


def test_moved_files_are_the_same_campaign_and_cases_are_leased_with_the_new_paths() -> None:
    bench = Bench()
    answered(bench, cases=3, **placed("/a"))
    bench.ask(hello())
    (first,) = bench.lease()
    bench.next(k=0, results=[result(first)])
    images: Snapshot = take(bench.state)
    bench.journal.append(images)
    bench.state = fold(bench.journal, bench.config)
    reply = answered(bench, cases=3, **placed("/b"))
    assert (reply.error, reply.status["resumed"]) == ("", True)
    (fact,) = bench.facts(Relocated)
    assert fact.paths == {f"/a/{n}": f"/b/{n}" for n in ("car.yaml", "net.onnx", "map.json")}
    assert answered(bench, cases=3, **placed("/b")).status["resumed"]
    assert len(bench.facts(Relocated)) == 1
    (second,) = bench.lease()
    assert second.case.variation.perception.model == "/b/net.onnx"
    assert second.case.rig.vehicle == "/b/car.yaml"
    assert second.case.rig.source.files == ["/b/map.json"]
    assert set(second.case.variation.files) == {"/b/net.onnx"}
    assert set(second.case.rig.files) == {"/b/car.yaml", "/b/net.onnx"}
    assert second.case.rig.models == ["/b/net.onnx"]
    assert case_digest(second.case) == case_digest(bench.state.campaigns["alpha"].ordered[1].case)
    bench.next(k=0, ended=[ended(second, "released")])
    # A restart knows it, also from a snapshot.
    assert fold([take(bench.state)], bench.config).campaigns == bench.state.campaigns
    campaign = bench.state.campaigns["alpha"]
    assert campaign.digest == campaign_digest(campaign.campaign, expand(campaign.campaign))


def test_a_refused_rig_charges_nothing_and_its_worker_gets_no_case_of_the_campaign() -> None:
    bench = started(cases=2, workers=2, attempts_max=1)
    first, second = bench.lease(k=2)
    why = "stack mine:X: near.py has changed since the campaign was submitted; put it back"
    assert (
        bench.lease(k=2, ended=[ended(first, "refused", why), ended(second, "refused", why)]) == []
    )
    assert bench.facts(CaseEnded) == []
    (note,) = bench.status()["notes"]
    assert note == f"w1: {why}; it gets no case of campaign 'alpha' until it is started again"
    bench.ask(submit("beta", cases=1))
    (other,) = bench.lease(k=2)
    assert other.case.variation.campaign == "beta"
    bench.restart()
    assert bench.status()["notes"] == [note]
    assert fold([take(bench.state)], bench.config).workers["w1"].refused == {"alpha": why}
    leases = bench.lease("w2", k=2)
    assert [lease.attempt for lease in leases] == [2, 2]
    assert not any(lease.alone for lease in leases)


def test_digests_and_rig_keys_see_contents_and_no_paths() -> None:
    def case(**fields: Any) -> Any:
        campaign, mistakes = parse_campaign({"campaign": "c", "matrix": {"repeat": [0]}, **fields})
        assert not mistakes
        assert campaign is not None
        return expand(campaign)[0]

    here, there, other = case(**placed("/a")), case(**placed("/b")), case(**placed("/a", "f" * 64))
    assert case_digest(here) == case_digest(there) != case_digest(other)
    assert rig_key(here) == rig_key(there) != rig_key(other), "a stack sees one campaign's networks"
    stack = case(**{**placed("/a"), "stack_identity": TWO})
    assert case_digest(stack) != case_digest(here)
    assert rig_key(stack) != rig_key(here)
    assert here.rig.source.identity == StackIdentity(**ONE)


def test_a_file_that_a_parameter_names_counts_in_the_cases_that_name_it() -> None:
    def cases(content: str) -> Any:
        data = {
            "campaign": "c",
            "matrix": {"autonomy.parameters.map": ["a.json", "b.json"]},
            "stack_identity": {**ONE, "named": {"a.json": "a" * 64, "b.json": content}},
        }
        campaign, mistakes = parse_campaign(data)
        assert not mistakes
        assert campaign is not None
        return expand(campaign)

    before, after = cases("b" * 64), cases("c" * 64)
    assert [case.rig.source.parameters for case in after] == [{"map": "a" * 64}, {"map": "c" * 64}]
    assert [rig_key(a) == rig_key(b) for a, b in zip(before, after, strict=True)] == [True, False]
    same = [case_digest(a) == case_digest(b) for a, b in zip(before, after, strict=True)]
    assert same == [True, False]
