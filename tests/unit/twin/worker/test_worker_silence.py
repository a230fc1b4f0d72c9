"""How long a worker waits for a conductor that does not answer any more."""

import pytest
from test_worker_core import hello, joined, lease, reply, result, working

from schemas.wire.control import Hello
from twin.worker.core import SECOND_NS, Core
from twin.worker.effects import Leave, Say, SpoolWrite, StopRig
from twin.worker.held import Silence
from twin.worker.spool import pack

LIMIT_NS = 120 * SECOND_NS
TOLD = Say("conductor does not answer; cases go on, results wait")


def silent(core, request, *times_ns):
    """What a core does when ``request`` gets no answer, again and again."""
    effects = []
    for now_ns in times_ns:
        core.asking = True
        effects += core.on_reply(request, None, now_ns)
    return effects


def impatient(core):
    core.silence = Silence(LIMIT_NS)
    return core


def test_an_idle_worker_leaves_at_the_limit_and_not_before():
    core, request = joined()
    impatient(core)
    begun = 7 * SECOND_NS
    assert silent(core, request, begun, begun + 1, begun + LIMIT_NS - 1) == [TOLD]
    why = "no conductor has answered for 120 s"
    assert silent(core, request, begun + LIMIT_NS) == [Leave(silent=why)]
    assert core.phase == "left"
    assert core.on_time(begun + 2 * LIMIT_NS) == []


def test_without_a_limit_it_waits_as_long_as_it_may_live():
    core, request = joined()
    assert silent(core, request, 0, 1, 10**6 * LIMIT_NS) == [TOLD]


def test_a_worker_that_was_never_answered_leaves_too():
    core = impatient(Core(hello()))
    (ask,) = core.on_time(0)
    assert isinstance(ask.request, Hello)
    (end,) = silent(core, ask.request, 0, LIMIT_NS)[-1:]
    assert end == Leave(silent="no conductor has answered for 120 s")


def test_an_answer_begins_the_time_anew():
    core, request = joined()
    impatient(core)
    silent(core, request, 0, LIMIT_NS - 1)
    core.on_reply(request, reply(seq=1), LIMIT_NS - 1)
    (ask,) = core.on_time(2 * LIMIT_NS)
    assert silent(core, ask.request, 2 * LIMIT_NS, 3 * LIMIT_NS - 1) == [TOLD]
    assert isinstance(silent(core, ask.request, 3 * LIMIT_NS)[-1], Leave)


def test_a_conductor_that_answers_heartbeats_is_there_though_a_store_is_not():
    """Requests whose results wait for a store get no answer, and heartbeats do."""
    core, request = joined()
    impatient(core)
    for turn in range(9):
        silent(core, request, turn * LIMIT_NS, (turn + 1) * LIMIT_NS - 1)
        core.silence.heard()
    assert core.phase == "working"


def test_a_running_case_goes_on_and_its_result_is_waited_for_as_long_as_it_took():
    """From its end, also where the silence began long before."""
    core = impatient(working(tokens=(1,)))
    (ask,) = core.on_time(15 * SECOND_NS // 4)
    began = core.held[1].began_ns
    assert silent(core, ask.request, 0, 9 * LIMIT_NS) == [TOLD]
    core.on_done(result(1), 9 * LIMIT_NS)
    (ask,) = core.on_time(9 * LIMIT_NS)
    until = 18 * LIMIT_NS - began
    assert silent(core, ask.request, 10 * LIMIT_NS, until - 1) == []
    assert silent(core, ask.request, until) == [
        Leave(silent=f"no conductor has answered for {until / 1e9:.0f} s; 1 result not delivered")
    ]


def test_what_it_leaves_with_lies_in_the_spool():
    """It waits for the longest of its results."""
    core = impatient(working(tokens=(1, 2)))
    core.on_done(result(1), 300 * SECOND_NS)
    core.on_done(result(2), 301 * SECOND_NS)
    (ask,) = core.on_time(301 * SECOND_NS)
    effects = silent(core, ask.request, 302 * SECOND_NS, 602 * SECOND_NS - 1)
    assert [type(effect) for effect in effects] == [Say, SpoolWrite, SpoolWrite]
    assert effects[1] == SpoolWrite(1, pack(result(1), hello()))
    (end,) = silent(core, ask.request, 602 * SECOND_NS)
    assert end.silent.endswith("for 300 s; 2 results not delivered")


def test_results_that_were_delivered_are_not_waited_for():
    core = impatient(working(tokens=(1,)))
    core.on_done(result(1), 500 * SECOND_NS)
    (ask,) = core.on_time(500 * SECOND_NS)
    core.on_reply(ask.request, reply(seq=2), 500 * SECOND_NS)
    (ask,) = core.on_time(510 * SECOND_NS)
    begun = 510 * SECOND_NS
    assert silent(core, ask.request, begun, begun + LIMIT_NS)[-1] == Leave(
        silent="no conductor has answered for 120 s"
    )


@pytest.mark.parametrize("tokens", [(1,), (1, 2)])
def test_a_rig_that_dies_meanwhile_leaves_nothing_to_wait_for(tokens):
    core = impatient(working(tokens=tokens))
    (ask,) = core.on_time(15 * SECOND_NS // 4)
    silent(core, ask.request, 0)
    assert StopRig() in core.on_rig_died("crash", "signal 9", SECOND_NS)
    assert isinstance(silent(core, ask.request, LIMIT_NS)[-1], Leave)


def test_a_conductor_that_does_not_know_us_is_one_that_answers():
    """Another one has its address: the worker joins it."""
    core, request = joined()
    impatient(core)
    silent(core, request, 0, LIMIT_NS - 1)
    core.asking = True
    core.on_reply(request, reply(error="unknown worker, say hello"), LIMIT_NS - 1)
    (ask,) = core.on_time(LIMIT_NS + SECOND_NS)
    assert isinstance(ask.request, Hello)
    core.on_reply(ask.request, reply(), LIMIT_NS + SECOND_NS)
    (ask,) = core.on_time(LIMIT_NS + SECOND_NS)
    assert core.on_reply(ask.request, reply(seq=1, leases=[lease(9)]), LIMIT_NS + SECOND_NS)
    assert [*core.held] == [9]
