"""Runs with a page beside runs without: what the page is found to cost, and when nobody can say."""

import pytest

from twin.base.errors import InfrastructureError
from viewer.bench.command import misses
from viewer.bench.compare import CampaignRun, CampaignWindow, LookedOn
from viewer.bench.pairs import Pair, compare, lines
from viewer.bench.running import Onlooker

CASES = 10


def run(wall_s, cpu_s=None, looked=None, fingerprint="same", slower=1.0, **parts_s):
    """Ten cases in so many seconds, and of one core unless said; ``parts_s``: by part."""
    measured = CampaignWindow(CASES, wall_s, wall_s if cpu_s is None else cpu_s, parts_s)
    walls = {f"c{n}": slower * (5.0 + n) for n in range(CASES)}
    return CampaignRun(CASES, measured, fingerprint, rig_wall_s=walls, looked=looked)


def looked(share=0.0, pictures=9, lags_s=(0.4, 0.6)):
    return LookedOn(share, pictures, lags_s)


def pairs(*walls, **changes):
    """Pairs of so many seconds without a page and with it."""
    values = {"looked": looked(), **changes}
    return [Pair(run(alone_s), run(page_s, **values)) for alone_s, page_s in walls]


def found(made):
    return {"pairs": {"campaign": "a/b.yaml", **compare(made)}}


def test_what_the_machine_does_beside_hits_both_of_a_pair():
    """Runs take twice as long in turns, pages cost nothing."""
    made = pairs((100, 100), (200, 201), (400, 399), (100, 100.5), (200, 199))
    share = compare(made)["share"]
    assert share["cases_per_min"]["median"] == 1.0
    assert share["rig_wall"] == {"median": 1.0, "noise": 0.0, "of": 5}
    assert misses(found(made)) == []
    told = lines(compare(made))
    assert "cases per minute: 100.0% of those without a page (within 0.5%)" in told[0]
    assert "pictures at most 0.6 s behind the simulators, mostly 0.5 s" in told
    assert not any("not shown" in line for line in told)


def test_what_a_page_costs_is_told_by_part():
    """Medians of the pairs; a part that ran with a page alone counts from nothing."""
    made = [
        Pair(
            run(100, simulators=50.0, conductor=2.0),
            run(100, looked=looked(share=0.02), simulators=used_s, conductor=2.1, judge=0.3),
        )
        for used_s in (50.4, 50.2, 90.0)
    ]
    assert compare(made)["cpu_more_s_per_case"] == {
        "conductor": 0.01,
        "judge": 0.03,
        "simulators": 0.04,
        "console": 0.2,
    }
    told = "conductor +10 ms, judge +30 ms, simulators +40 ms, console +200 ms"
    assert any(line.endswith(told) for line in lines(compare(made)))


def test_cases_of_one_run_are_no_proof_of_each_other():
    """What the machine did beside made all cases of a run slower: one value, and too few."""
    once = compare(pairs((100, 100), slower=1.5))
    assert once["share"]["rig_wall"] == {"median": 0.6667, "noise": 1.0, "of": 1}
    assert misses({"pairs": once}) == []
    made = pairs(*[(100, 100)] * 3)
    untimed = CampaignRun(CASES, made[0].console.measured, "same", looked=looked())
    assert compare([*made, Pair(made[0].alone, untimed)])["share"]["rig_wall"]["of"] == 3


def test_one_run_that_was_disturbed_moves_no_median():
    made = pairs((100, 100), (100, 100), (100, 300), (100, 100), (100, 100))
    assert misses(found(made)) == []
    assert compare(made)["share"]["cases_per_min"]["median"] == 1.0


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (pairs(*[(100, 103)] * 4, cpu_s=100), "cases per minute: 97.1%"),
        (pairs(*[(100, 100)] * 4, slower=1.03), "speed of the rigs, case by case: 97.1%"),
        (pairs(*[(100, 100)] * 4, cpu_s=103), "cases per processor second"),
        (pairs(*[(100, 100)] * 4, looked=looked(share=0.03)), "the console's included: 97.1%"),
        (pairs(*[(100, 100)] * 4, fingerprint="other"), "the results differ"),
        (pairs(*[(100, 100)] * 4, looked=looked(pictures=0)), "was given no picture"),
        (pairs(*[(100, 100)] * 4, looked=looked(lags_s=(0.4, 2.1))), "pictures lag 2.1 s"),
        (pairs(*[(100, 100)] * 4, looked=looked(lags_s=())), "nobody knows how far"),
    ],
)
def test_each_target_can_be_missed(made, words):
    [line] = misses(found(made))
    assert words in line


def test_exactly_at_the_target_nothing_is_missed():
    share = 1 / 0.98
    made = pairs(*[(98, 98 * share)] * 4, slower=share)
    assert misses(found(made)) == []


def test_what_noise_hides_is_told_and_no_miss():
    made = pairs((100, 104), (100, 80), (100, 130), slower=1.0)
    made = [Pair(p.alone, run(p.console.measured.wall_s, looked=looked())) for p in made]
    assert misses(found(made)) == []
    once = pairs((100, 300), slower=3.0)
    assert misses(found(once)) == [], "one pair says nothing"
    assert "too few to be sure" in lines(compare(once))[0]


def test_a_campaign_that_nobody_could_look_at_is_no_measurement(tmp_path):
    with pytest.raises(InfrastructureError, match="before anybody saw a picture"):
        Onlooker(None, tmp_path).look()
