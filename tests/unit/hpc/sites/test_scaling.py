"""How many workers, and where: exact limits."""

import dataclasses

import pytest

from hpc.sites.scaling import (
    FAILURES_MAX,
    LONGEST_REST_S,
    CaseDemand,
    SiteRoom,
    Standing,
    WorkerTarget,
    decide,
    rest_s,
    wanted_workers,
)

NORTH = SiteRoom("north", workers=2, allocations=3, queued=1, walltime_h=1.0)
SOUTH = SiteRoom("south", workers=1, allocations=8, queued=2, walltime_h=0.5)
ANY = WorkerTarget(0, 100)


def demand(left=100, waiting=None, case_s=60.0, slots=1):
    return CaseDemand(left, left if waiting is None else waiting, case_s, slots)


def decision(asked, rooms=(NORTH, SOUTH), standings=(), target=ANY, spent_h=0.0, now_s=0.0):
    return decide(asked, rooms, standings, target, spent_h=spent_h, now_s=now_s)


@pytest.mark.parametrize(
    ("asked", "target", "workers"),
    [
        (demand(left=10, case_s=None), ANY, 3),  # one allocation of each site, to learn
        (demand(left=2, case_s=None), ANY, 2),
        (demand(left=10, case_s=60.0), ANY, 10),
        (demand(left=10, case_s=59.0), ANY, 10),
        (demand(left=10, case_s=54.0), ANY, 9),
        (demand(left=10, case_s=6.0), ANY, 1),
        (demand(left=10, case_s=600.0), ANY, 10),  # more would find no case
        (demand(left=10, case_s=600.0, slots=4), ANY, 3),
        (demand(left=10, case_s=600.0), WorkerTarget(0, 4), 4),
        (demand(left=10, case_s=6.0), WorkerTarget(3, 4), 3),
    ],
)
def test_wanted(asked, target, workers):
    assert wanted_workers(asked, (NORTH, SOUTH), target)[0] == workers


def test_sites_are_asked_in_their_order_as_long_as_their_queues_have_room():
    found = decision(demand(left=50))
    assert [ask.site for ask in found.asks] == ["north", "south", "south"]
    assert found.notes == [
        "north: 1 allocation in its queue already",
        "south: 2 allocations in its queue already",
    ]


def test_running_allocations_leave_the_queue():
    running = [Standing("north-1", "north", 2, "running", present=2, held=2)]
    assert [ask.site for ask in decision(demand(left=3), standings=running).asks] == ["north"]


@pytest.mark.parametrize(
    ("change", "note"),
    [
        ({"allocations": 1}, "north: has its 1 allocation"),
        ({"failures": FAILURES_MAX}, "north: 6 failures in a row, nothing more is asked of it"),
        (
            {"failures": 2, "rests_until_s": 30.0},
            "north: rests after 2 failures for another 30 s",
        ),
    ],
)
def test_a_site_without_room(change, note):
    running = [Standing("north-1", "north", 2, "running", present=2, held=2)]
    room = dataclasses.replace(NORTH, **change)
    found = decision(demand(left=50), rooms=(room,), standings=running)
    assert not found.asks
    assert found.notes == [note]


def test_a_rest_ends():
    room = dataclasses.replace(NORTH, failures=1, rests_until_s=30.0)
    assert not decision(demand(), rooms=(room,), now_s=29.9).asks
    assert decision(demand(), rooms=(room,), now_s=30.0).asks


def test_rests_grow_up_to_a_limit():
    assert [rest_s(count) for count in (0, 1, 2, 3)] == [0.0, 30.0, 60.0, 120.0]
    assert rest_s(500) == LONGEST_REST_S


def test_no_more_than_the_target_allows():
    found = decision(demand(left=50), rooms=(NORTH,), target=WorkerTarget(0, 1))
    assert not found.asks
    assert found.notes == ["north: 2 more would be above 1 worker"]


def test_no_more_than_the_worker_hours_allow():
    target = WorkerTarget(0, 100, worker_hours=2.0)
    assert decision(demand(), rooms=(NORTH,), target=target).asks
    found = decision(demand(), rooms=(NORTH,), target=target, spent_h=0.1)
    assert not found.asks
    assert "above 2 worker-hours, of which 0.1 are spent or promised" in found.notes[0]


def test_a_site_that_does_not_answer_counts_for_what_is_seen_of_it():
    lost = [Standing("north-1", "north", 2, "unreachable", present=0)]
    found = decision(demand(left=2), rooms=(SOUTH,), standings=lost)
    assert [ask.site for ask in found.asks] == ["south", "south"]
    seen = [dataclasses.replace(lost[0], present=2)]
    assert not decision(demand(left=2), rooms=(SOUTH,), standings=seen).asks


@pytest.mark.parametrize(
    ("present", "has_job", "asked"), [(0, True, 0), (1, True, 1), (0, False, 1)]
)
def test_a_job_of_which_nothing_is_known_may_be_in_the_queue(present, has_job, asked):
    """Its site may answer, and take one after the other."""
    lost = [Standing("north-1", "north", 2, "unreachable", present=present, has_job=has_job)]
    found = decision(demand(left=50), rooms=(NORTH,), standings=lost)
    assert len(found.asks) == asked
    assert found.notes == ["north: 1 allocation in its queue already"]


def test_the_newest_that_wait_go_first_and_idle_ones_next():
    standings = [
        Standing("north-1", "north", 2, "running", present=2, held=1),
        Standing("south-2", "south", 1, "running", present=1, held=0),
        Standing("south-3", "south", 1, "queued"),
    ]
    busy = decision(demand(left=3, waiting=2, case_s=600.0), standings=standings)
    assert [end.id for end in busy.ends] == ["south-3"]
    last = decision(demand(left=1, waiting=0, case_s=600.0), standings=standings)
    assert [end.id for end in last.ends] == ["south-3", "south-2"]


def test_above_what_is_allowed_also_those_that_work_end_the_least_busy_first():
    standings = [
        Standing("south-1", "south", 1, "running", present=1, held=0),
        Standing("south-2", "south", 1, "running", present=1, held=2),
        Standing("south-3", "south", 1, "running", present=1, held=1),
        Standing("north-4", "north", 2, "running", present=2, held=1),
        Standing("south-5", "south", 1, "queued"),
    ]
    ends = [
        [end.id for end in decision(demand(), standings=standings, target=target).ends]
        for target in (WorkerTarget(0, most) for most in (6, 5, 4, 1))
    ]
    assert ends == [
        [],
        ["south-5"],
        ["south-5", "south-1"],
        ["south-5", "south-1", "north-4", "south-3"],
    ]


def test_all_end_when_no_case_is_left():
    standings = [Standing("north-1", "north", 2, "running", present=2)]
    found = decision(demand(left=0), standings=standings, target=WorkerTarget(2, 9))
    assert [(end.id, end.why) for end in found.ends] == [("north-1", "every case has ended")]
    assert not found.asks
