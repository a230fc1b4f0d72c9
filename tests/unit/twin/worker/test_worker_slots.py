"""twin.worker.core: a rig holds what its stack drives and what fits, whatever was leased before."""

from __future__ import annotations

from case_changes import changed
from test_worker_core import CASES, joined, lease, reply, result

from twin.worker.core import PORTION_MAX, SECOND_NS
from twin.worker.effects import AssignLease, StartRig


def test_a_stack_that_drives_one_car_gets_one_case_at_a_time():
    """Asked for two before the stack was known: the second is given back, uncharged."""
    core, request = joined(slots=2)
    single = [changed(case, slots=1) for case in CASES]
    leases = [lease(token, single[token - 1]) for token in (1, 2)]
    assert core.on_reply(request, reply(seq=1, leases=leases), 0) == [StartRig(leases[0], 1)]
    assert core.on_rig_ready() == [AssignLease(leases[0])]
    (ask,) = core.on_time(0)
    assert [(e.token, e.reason) for e in ask.request.ended] == [(2, "released")]
    assert ask.request.held == [1]
    assert ask.request.k == 0
    core.on_reply(ask.request, reply(seq=2), 0)
    core.on_done(result(1), SECOND_NS)
    (ask,) = core.on_time(SECOND_NS)
    assert ask.request.k == 1  # the rig waits for one, not for two


def test_a_rig_has_no_more_slots_than_fit():
    """What was leased before that was known is given back, and no more is asked for."""
    core, request = joined(slots=2)
    asked = []
    core.fitting = lambda case: asked.append(case.id) or 1
    leases = [lease(1), lease(2)]
    effects = core.on_reply(request, reply(seq=1, leases=leases), 0)
    assert effects == [StartRig(leases[0], 1)]
    assert [(each.token, each.detail) for each in core.ended] == [(2, "the rig drives 1 at once")]
    assert list(core.held) == [1]
    assert asked == [leases[0].case.id]
    assert core._free() == 0


def test_cases_that_simulate_nothing_are_asked_for_in_growing_portions():
    """They need no slot; with the first one that does, slots count again."""
    core, request = joined(slots=1)
    noop = changed(CASES[0], simulator="noop")
    asked, token = [request.k], 0
    for seq in range(1, 9):
        leases = [lease(token + n, noop) for n in range(request.k)]
        token += request.k
        assert core.on_reply(request, reply(seq=seq, leases=leases), 0) == []
        (ask,) = core.on_time(0)
        request = ask.request
        assert [each.token for each in request.results] == [each.token for each in leases]
        asked.append(request.k)
    assert asked == [1, 2, 4, 8, 16, PORTION_MAX, PORTION_MAX, PORTION_MAX, PORTION_MAX]
    real = [lease(token + n) for n in range(3)]
    assert core.on_reply(request, reply(seq=9, leases=real), 0) == [StartRig(real[0], 1)]
    assert list(core.held) == [token]
    (ask,) = core.on_time(0)
    assert (ask.request.k, len(ask.request.ended)) == (0, 2)


def test_a_reply_without_cases_ends_the_portions():
    core, request = joined(slots=1)
    noop = changed(CASES[0], simulator="noop")
    core.on_reply(request, reply(seq=1, leases=[lease(1, noop)]), 0)
    (ask,) = core.on_time(0)
    assert ask.request.k == 2
    core.on_reply(ask.request, reply(seq=2), 0)
    (ask,) = core.on_time(SECOND_NS)
    assert ask.request.k == 1


def test_a_worker_that_leaves_asks_for_no_portion():
    core, request = joined(slots=1)
    noop = changed(CASES[0], simulator="noop")
    core.on_reply(request, reply(seq=1, leases=[lease(1, noop)]), 0)
    core.on_drain("SIGTERM", 0)
    (ask,) = core.on_time(0)
    assert (ask.request.k, len(ask.request.results)) == (0, 1)
