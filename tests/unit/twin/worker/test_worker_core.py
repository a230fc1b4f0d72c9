"""The worker's decisions: events in, effects out."""

from functools import partial

import msgspec
import pytest
from case_changes import changed

from schemas import SCHEMA_VERSION
from schemas.case import CASE_VERSION
from schemas.identity import rig_key
from schemas.plan import expand, parse_campaign
from schemas.wire.codec import decode
from schemas.wire.control import Beat, Bye, Hello, Lease, Next, Reply, Result, Touch
from twin.fabric.session import is_sealed, signer_of
from twin.worker.core import GOODBYE_TRIES, IDLE_NS, RETRY_NS, SECOND_NS, Core
from twin.worker.effects import (
    AbandonToken,
    Ask,
    AssignLease,
    FailCase,
    FailUnbegun,
    KeepLogs,
    Leave,
    Say,
    SpoolForget,
    SpoolWrite,
    StartRig,
    StopRig,
)
from twin.worker.spool import pack, unpack

CAMPAIGN, _ = parse_campaign(
    {"campaign": "c", "deadline_s": 5, "matrix": {"weather": ["clear", "cloudy", "heavy_fog"]}}
)
CASES = expand(CAMPAIGN)


def hello(slots=2):
    return Hello(
        v=SCHEMA_VERSION,
        worker="w",
        host="h",
        pid=1,
        device_class="cpu",
        software="s",
        slots=slots,
        session=bytes(range(32)),
    )


def lease(token, case=CASES[0], **changes):
    return Lease(token=token, attempt=1, out="/out", case=case, **changes)


def reply(**changes):
    return Reply(v=SCHEMA_VERSION, epoch=1, **{"ttl_s": 15.0, "left": 3, **changes})


def result(token):
    return Result("c", CASES[0].id, token, "verdict", "pass")


def joined(slots=2):
    """A core that has said hello, and its first NEXT."""
    core = Core(hello(slots))
    (ask,) = core.on_time(0)
    assert isinstance(ask.request, Hello)
    assert core.on_reply(ask.request, reply(), 0) == []
    (ask,) = core.on_time(0)
    assert isinstance(ask.request, Next)
    return core, ask.request


def test_a_conductor_that_cannot_write_is_asked_again():
    core = Core(hello())
    (ask,) = core.on_time(0)
    full = reply(error="storage: full", retry_after_s=2.0)
    assert core.on_reply(ask.request, full, 0) == [Say("conductor: storage: full")]
    assert core.on_time(2 * SECOND_NS - 1) == []
    (again,) = core.on_time(2 * SECOND_NS)
    assert again == ask
    assert core.on_reply(again.request, reply(), 2 * SECOND_NS) == []
    assert core.phase == "working"


def test_a_refused_worker_leaves():
    core = Core(hello())
    (ask,) = core.on_time(0)
    assert core.on_reply(ask.request, reply(error="other software"), 0) == [Leave("other software")]


def working(slots=2, tokens=(1, 2)):
    """A core with a ready rig and leases."""
    core, request = joined(slots)
    leases = [lease(t, CASES[i]) for i, t in enumerate(tokens)]
    effects = core.on_reply(request, reply(seq=1, leases=leases), 0)
    assert effects == [StartRig(leases[0], slots)]
    assert core.on_rig_ready() == [AssignLease(each) for each in leases]
    return core


def leaving(why, cases):
    noun = "case is" if cases == 1 else "cases are"
    return Say(f"{why}: leaving, {cases} {noun} given back")


def given_back(core, why, end, act):
    """What a core does that gives back its running cases: their logs are written first."""
    leases = tuple(held.lease for held in core.held.values())
    return act() == [leaving(why, len(leases)), KeepLogs(leases, end), StopRig()]


def test_one_request_at_a_time():
    core, request = joined()
    assert request.k == 2
    assert core.on_time(10 * SECOND_NS) == []


def test_refused_hello_ends_the_worker():
    core = Core(hello())
    (ask,) = core.on_time(0)
    assert core.on_reply(ask.request, reply(error="wrong version"), 0) == [Leave("wrong version")]
    assert core.on_time(SECOND_NS) == []


def test_a_lease_of_another_shape_is_not_run():
    core, request = joined()
    new = lease(1, case_version=CASE_VERSION + 1)
    effects = core.on_reply(request, reply(seq=1, leases=[new]), 0)
    assert effects[-1] == Leave(
        f"the conductor leases cases of version {CASE_VERSION + 1}, this worker reads version "
        f"{CASE_VERSION}; install the same release on both sides"
    )
    assert not core.held
    assert not any(isinstance(effect, StartRig) for effect in effects)


def test_an_unanswered_next_is_repeated_unchanged():
    core, request = joined()
    core.on_reply(request, None, 0)
    assert core.on_time(RETRY_NS - 1) == []
    core.results.append(result(7))
    (ask,) = core.on_time(RETRY_NS)
    assert ask.request == request, "same seq, same content"
    core.on_reply(ask.request, reply(seq=1), RETRY_NS)
    (ask,) = core.on_time(RETRY_NS + IDLE_NS)
    assert ask.request.seq == 2
    assert [r.token for r in ask.request.results] == [7]


def test_silence_is_said_once_and_so_is_the_return():
    core, request = joined()
    said = []
    for n in range(4):
        said += core.on_reply(request, None, n)
        core.asking = True
    assert said == [Say("conductor does not answer; cases go on, results wait")]
    assert Say("conductor is back") in core.on_reply(request, reply(seq=1), 9)


def test_result_and_refill_in_one_request():
    core = working()
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    assert (ask.request.k, ask.request.held) == (1, [2])
    assert [r.token for r in ask.request.results] == [1]
    effects = core.on_reply(ask.request, reply(seq=2, leases=[lease(3, CASES[2])]), 6)
    assert effects == [AssignLease(lease(3, CASES[2]))]
    assert core.results == []


def test_results_finished_meanwhile_are_kept():
    core = working()
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    core.on_done(result(2), 6)
    core.on_reply(ask.request, reply(seq=2), 7)
    assert [r.token for r in core.results] == [2]


def test_another_rig_key_restarts_the_rig():
    core = working(slots=1, tokens=(1,))
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    assert ask.request.rig == rig_key(CASES[0])
    camera = msgspec.structs.replace(CASES[0].rig.camera, width=320)
    other = lease(2, changed(CASES[0], camera=camera))
    assert core.on_reply(ask.request, reply(seq=2, leases=[other]), 6) == [
        StopRig(),
        StartRig(other, 1),
    ]


def test_alone_means_a_fresh_rig_and_no_neighbours():
    core = working(slots=2, tokens=(1,))
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    alone = lease(2, alone=True)
    effects = core.on_reply(ask.request, reply(seq=2, leases=[alone]), 6)
    assert effects == [StopRig(), StartRig(alone, 2)]
    assert not any(isinstance(getattr(e, "request", None), Next) for e in core.on_time(7))


def test_a_dead_rig_charges_only_a_case_that_was_alone():
    core = working()
    core.on_rig_died("crash", "boom", 5)
    assert [(e.token, e.reason) for e in core.ended] == [(1, "suspect"), (2, "suspect")]
    core = working(slots=1, tokens=(1,))
    core.on_rig_died("crash", "boom", 5)
    assert [(e.token, e.reason, e.detail) for e in core.ended] == [(1, "crash", "boom")]


@pytest.mark.parametrize(("device_class", "apart"), [("cuda:H200", True), ("cpu:avx2", False)])
def test_on_a_gpu_a_case_that_runs_alone_leaves_its_rig_to_nobody(device_class, apart):
    """It takes turns with others there, which costs both; on a CPU nobody is in its way."""
    core = working(slots=1, tokens=(1,))
    core.hello = msgspec.structs.replace(core.hello, device_class=device_class)
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    core.on_reply(ask.request, reply(seq=2, leases=[lease(2, alone=True)]), 6)
    core.on_rig_ready()
    core.on_done(result(2), 8)
    (ask,) = core.on_time(8)
    shared = lease(3)
    effects = core.on_reply(ask.request, reply(seq=3, leases=[shared]), 9)
    assert effects == ([StopRig(), StartRig(shared, 1)] if apart else [AssignLease(shared)])


def test_on_a_gpu_only_a_case_that_runs_apart_is_charged():
    """Another rig of the GPU may have been the reason."""
    core = working(slots=1, tokens=(1,))
    core.hello = msgspec.structs.replace(core.hello, device_class="cuda:H200")
    core.on_rig_died("crash", "boom", 5)
    assert [(e.token, e.reason) for e in core.ended] == [(1, "suspect")]
    core.ended.clear()
    (ask,) = core.on_time(6 + RETRY_NS)
    core.on_reply(ask.request, reply(seq=2, leases=[lease(2, alone=True)]), 7 + RETRY_NS)
    core.on_rig_died("crash", "boom", 8 + RETRY_NS)
    assert [(e.token, e.reason) for e in core.ended] == [(2, "crash")]


def test_a_case_that_was_over_is_no_victim_of_its_rig():
    core = working()
    core.on_progress([2], [4], 5 * SECOND_NS - 1, over=[1])
    core.on_time(5 * SECOND_NS)
    assert core.ended == [], "the wait for the disk is nobody's deadline"
    core.on_rig_died("out_of_memory", "boom", 5 * SECOND_NS)
    assert [(e.token, e.reason) for e in core.ended] == [(1, "released"), (2, "out_of_memory")]
    core = working(slots=1, tokens=(1,))
    core.on_progress([], [], 5, over=[1])
    core.on_progress([], [], 6)  # its result could not be written
    core.on_rig_died("crash", "disk full", 7)
    assert [e.reason for e in core.ended] == ["crash"]


def failure(token):
    return msgspec.structs.replace(result(token), outcome="failed", verdict="")


def test_what_a_stack_raises_is_the_outcome_of_a_case_that_was_alone_with_it():
    core = working(slots=4, tokens=(1,))
    assert core.on_stack_failed("stack: KeyError: 'x'", 5) == [
        Say("rig ended (failed): stack: KeyError: 'x'"),
        FailCase(1, "stack: KeyError: 'x'"),
    ]
    assert core.on_stack_failed("stack exit code 1", 6, left=True) == [], "known already"
    core.on_progress([], [], 7, over=[1])
    assert core.on_time(7) == [], "no case is asked for meanwhile"
    assert core.on_done(failure(1), 8) == [StopRig()]
    assert (core.rig, core.ended, [r.outcome for r in core.results]) == (None, [], ["failed"])
    (ask,) = core.on_time(8)
    assert ask.request.k == 4


def test_of_several_cases_all_are_suspects_of_what_a_stack_raised():
    core = working()
    leases = tuple(held.lease for held in core.held.values())
    effects = core.on_stack_failed("stack: KeyError: 'x'", 5)
    assert effects[:2] == [KeepLogs(leases, "crash: stack: KeyError: 'x'"), StopRig()]
    assert [(e.token, e.reason) for e in core.ended] == [(1, "suspect"), (2, "suspect")]


def test_a_stack_that_cannot_be_loaded_is_the_outcome_of_all_that_wait_for_it():
    core, request = joined()
    leases = [lease(1, CASES[0]), lease(2, CASES[1])]
    core.on_reply(request, reply(seq=1, leases=leases), 0)
    assert core.on_stack_failed("stack: m:C: KeyError: 'x'", 5, left=True) == [
        Say("rig ended (failed): stack: m:C: KeyError: 'x'"),
        FailUnbegun(tuple(leases), "stack: m:C: KeyError: 'x'"),
    ]
    assert core.on_done(failure(1), 6) == []
    assert core.on_done(failure(2), 6) == [StopRig()]


@pytest.mark.parametrize(("alone", "reason"), [(False, "suspect"), (True, None)])
def test_on_a_gpu_another_rig_may_be_why_a_stack_raised(alone, reason):
    core, request = joined(1)
    core.hello = msgspec.structs.replace(core.hello, device_class="cuda:H200")
    core.on_reply(request, reply(seq=1, leases=[lease(1, alone=alone)]), 0)
    core.on_rig_ready()
    core.on_stack_failed("stack: RuntimeError: CUDA error 700", 5)
    assert [e.reason for e in core.ended] == ([reason] if reason else [])
    assert bool(core.held) is alone


def test_a_stack_that_leaves_while_the_worker_does_has_no_outcome():
    """A scheduler that ends a job may have asked all of its processes to."""
    core = draining(10)
    core.on_drain("SIGTERM", 0)
    core.on_stack_failed("stack exit code 1", 1, left=True)
    assert [e.reason for e in core.ended] == ["released", "released"]


def test_a_case_granted_to_a_rig_whose_stack_has_failed_goes_back():
    core = working(slots=2, tokens=(1,))
    (ask,) = core.on_time(0)
    core.on_stack_failed("stack: KeyError: 'x'", 5)
    assert core.on_reply(ask.request, reply(seq=2, leases=[lease(2, CASES[1])]), 6) == []
    assert [(e.token, e.reason) for e in core.ended] == [(2, "released")]
    assert core.on_done(failure(1), 7) == [StopRig()]


def test_a_worker_whose_port_is_taken_waits_for_its_end_and_asks_for_nothing():
    core, request = joined(1)
    core.on_reply(request, reply(seq=1, leases=[lease(1)]), 0)
    (said,) = core.on_port_taken(4567, 1)
    assert "waits for port 4567, which another rig of this host uses" in said.line
    (ask,) = core.on_time(1)
    assert (ask.request.k, [e.reason for e in ask.request.ended]) == (0, ["released"])
    core.on_reply(ask.request, reply(seq=2), 2)
    for now in range(3, 60):
        for effect in core.on_time(now * SECOND_NS):
            assert isinstance(effect.request, Beat)
            core.on_reply(effect.request, reply(), now * SECOND_NS)
    core.on_port_free(60 * SECOND_NS)
    (ask,) = core.on_time(60 * SECOND_NS)
    assert ask.request.k == 1


@pytest.mark.parametrize("tokens", [(1,), (1, 2)])
def test_a_host_without_room_for_a_rig_charges_nobody(tokens):
    core = working(tokens=tokens)
    effects = core.on_rig_died("released", "no rig: Too many open files", 5)
    assert effects == [StopRig(), Say("rig ended (released): no rig: Too many open files")]
    assert [e.reason for e in core.ended] == ["released"] * len(tokens)


def test_rigs_that_keep_dying_are_slowed_down():
    core = working(slots=1, tokens=(1,))
    core.on_rig_died("crash", "boom", 0)
    assert core.ask_at_ns == 0
    core.on_rig_died("crash", "boom", 0)
    second = core.ask_at_ns
    core.on_rig_died("crash", "boom", 0)
    assert 0 < second < core.ask_at_ns <= 10 * SECOND_NS


@pytest.mark.parametrize(
    ("wait_ns", "stalled"), [(5 * SECOND_NS - 1, False), (5 * SECOND_NS, True)]
)
def test_the_deadline_is_exact(wait_ns, stalled):
    core = working(slots=1, tokens=(1,))
    core.on_progress([1], [4], 7)
    effects = core.on_time(7 + wait_ns)
    assert (StopRig() in effects) is stalled
    if stalled:
        assert core.ended[0].reason == "deadline"
        assert "tick 4" in core.ended[0].detail


def test_progress_without_movement_does_not_move_the_deadline():
    core = working(slots=1, tokens=(1,))
    core.on_progress([1], [4], 0)
    core.on_progress([1], [4], 4 * SECOND_NS)
    assert StopRig() in core.on_time(5 * SECOND_NS)


def test_preparing_a_rig_is_no_time_of_a_case():
    core = working(slots=1, tokens=(1,))
    core.on_preparing(4 * SECOND_NS)
    assert StopRig() not in core.on_time(9 * SECOND_NS - 1)
    assert StopRig() in core.on_time(9 * SECOND_NS)


def test_beats_carry_progress():
    core = working()
    core.on_progress([1, 2], [10, 20], 5)
    period_ns = 15 * SECOND_NS // 4
    assert core.on_time(period_ns - 1) == []
    (ask,) = core.on_time(period_ns)
    assert ask.request == Beat(
        v=SCHEMA_VERSION, worker="w", held={"1": 10, "2": 20}, session=hello().session
    )
    effects = core.on_reply(ask.request, reply(lost=[2]), period_ns)
    assert effects == [AbandonToken(2)]
    assert list(core.held) == [1]
    assert core.on_done(result(2), period_ns + 1) == []
    assert core.results == [], "a lost token's result is dropped"


def test_drain_gives_back_and_leaves():
    core = working()
    drain = partial(core.on_drain, "SIGTERM", 5)
    assert given_back(core, "SIGTERM", "released: SIGTERM", drain)
    (ask,) = core.on_time(5)
    assert ask.request.k == 0
    assert {e.reason for e in ask.request.ended} == {"released"}
    core.on_reply(ask.request, reply(seq=2), 6)
    (ask,) = core.on_time(6)
    assert isinstance(ask.request, Bye)
    assert core.on_reply(ask.request, reply(), 7) == [Leave()]


def test_drain_without_a_conductor_ends_after_some_tries():
    core = working()
    core.on_drain("SIGTERM", 0)
    now = 0
    for _ in range(GOODBYE_TRIES):
        now = max(now, core.ask_at_ns)
        (ask,) = core.on_time(now)
        effects = core.on_reply(ask.request, None, now)
    assert Leave() in effects


def test_drain_before_hello_leaves_at_once():
    core = Core(hello())
    core.on_time(0)
    assert core.on_drain("SIGTERM", 1) == [Leave()]


def test_leases_granted_while_leaving_are_handed_back():
    core, request = joined()
    core.on_drain("SIGTERM", 1)
    assert core.on_reply(request, reply(seq=1, leases=[lease(9)]), 2) == []
    assert [(e.token, e.reason) for e in core.ended] == [(9, "released")]


@pytest.mark.parametrize(("left", "told"), [(0, False), (2, True)])
def test_a_worker_that_leaves_knows_whether_cases_are_left(left, told):
    """Who starts it again needs to know; the conductor says it in every answer."""
    core = Core(hello(), until_done=True)
    (ask,) = core.on_time(0)
    core.on_reply(ask.request, reply(), 0)
    assert core.cases_left
    (ask,) = core.on_time(0)
    core.on_reply(ask.request, reply(seq=1, left=left, drain=True), 1)
    assert core.phase == "draining"
    assert core.cases_left is told


def test_until_done_leaves_when_nothing_is_left():
    core = Core(hello(), until_done=True)
    (ask,) = core.on_time(0)
    core.on_reply(ask.request, reply(), 0)
    (ask,) = core.on_time(0)
    core.on_reply(ask.request, reply(seq=1, left=0), 1)
    assert core.phase == "draining"


def test_a_forgotten_worker_says_hello_again():
    core = working()
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    core.on_reply(ask.request, reply(error="unknown worker, say hello"), 6)
    (ask,) = core.on_time(6 + IDLE_NS)
    assert isinstance(ask.request, Hello)
    core.on_reply(ask.request, reply(), 7 + IDLE_NS)
    (ask,) = core.on_time(7 + IDLE_NS)
    assert [r.token for r in ask.request.results] == [1], "nothing was lost"


def test_noop_cases_end_at_once():
    core, request = joined()
    noop = lease(5, changed(CASES[0], simulator="noop"))
    assert core.on_reply(request, reply(seq=1, leases=[noop]), 3) == []
    (ask,) = core.on_time(3)
    assert isinstance(ask, Ask)
    assert [(r.token, r.verdict) for r in ask.request.results] == [(5, "pass")]


def draining(drain_s, walltime_end_ns=None):
    core = working()
    core.drain_ns = drain_s * SECOND_NS
    core.walltime_end_ns = walltime_end_ns
    return core


def test_a_drain_lets_running_cases_end():
    core = draining(10)
    assert core.on_drain("SIGTERM", 0) == [Say("SIGTERM: 2 cases may end within 10 s")]
    assert core.phase == "finishing"
    core.on_done(result(1), SECOND_NS)
    (ask,) = core.on_time(SECOND_NS)
    assert (ask.request.k, ask.request.held) == (0, [2])
    core.on_reply(ask.request, reply(seq=2, drain=True), SECOND_NS)
    (ask,) = core.on_time(4 * SECOND_NS)
    assert isinstance(ask.request, Beat), "the other case still lives"
    core.on_reply(ask.request, reply(drain=True), 4 * SECOND_NS)
    core.on_done(result(2), 5 * SECOND_NS)
    assert core.on_time(5 * SECOND_NS)[:2] == [leaving("SIGTERM", 0), StopRig()]
    assert core.phase == "draining"
    assert core.ended == []


@pytest.mark.parametrize(("now_ns", "over"), [(10 * SECOND_NS - 1, False), (10 * SECOND_NS, True)])
def test_the_end_of_a_drain_is_exact(now_ns, over):
    core = draining(10)
    core.on_drain("SIGTERM", 0)
    for token, held in core.held.items():
        core.on_progress([token], [7], 9 * SECOND_NS)
        assert held.progress == 7
    core.asking = True
    assert (StopRig() in core.on_time(now_ns)) is over
    assert [e.reason for e in core.ended] == (["released"] * 2 if over else [])


def test_a_second_signal_gives_back_at_once():
    core = draining(10)
    core.on_drain("SIGTERM", 0)
    drain = partial(core.on_drain, "SIGTERM", 1)
    assert given_back(core, "SIGTERM", "released: SIGTERM", drain)
    assert len(core.ended) == 2


def test_without_running_cases_a_drain_ends_at_once():
    core, _ = joined()
    core.drain_ns = SECOND_NS
    assert core.on_drain("SIGUSR1", 0) == [leaving("SIGUSR1", 0)]
    assert core.phase == "draining"


@pytest.mark.parametrize(("now_ns", "drains"), [(SECOND_NS - 1, False), (SECOND_NS, True)])
def test_the_walltime_begins_a_drain(now_ns, drains):
    core = draining(4, walltime_end_ns=5 * SECOND_NS)
    core.asking = True
    core.on_time(now_ns)
    assert (core.phase == "finishing") is drains


def test_the_walltime_gives_back_with_its_own_reason():
    core = draining(0, walltime_end_ns=2 * SECOND_NS)
    core.asking = True
    assert core.on_time(2 * SECOND_NS - 1) == []
    why = "the walltime ends"
    assert given_back(core, why, f"walltime: {why}", lambda: core.on_time(2 * SECOND_NS))
    assert [e.reason for e in core.ended] == ["walltime"] * 2


def test_a_drain_never_outlasts_the_walltime():
    core = draining(10, walltime_end_ns=100 * SECOND_NS)
    core.on_drain("SIGTERM", 95 * SECOND_NS)
    assert core.drain_until_ns == 100 * SECOND_NS


def test_requests_say_how_much_walltime_is_left():
    core = draining(2, walltime_end_ns=10 * SECOND_NS)
    core.on_done(result(1), SECOND_NS)
    (ask,) = core.on_time(SECOND_NS)
    assert ask.request.remaining_s == 7.0
    core, request = joined()
    assert request.remaining_s is None


def test_a_heartbeat_may_ask_to_drain():
    core = working()
    (ask,) = core.on_time(15 * SECOND_NS // 4)
    why, now = "conductor asked to drain", 15 * SECOND_NS // 4
    drain = partial(core.on_reply, ask.request, reply(drain=True), now)
    assert given_back(core, why, f"released: {why}", drain)
    assert core.phase == "draining"


def test_results_that_wait_are_spooled_and_forgotten_when_settled():
    core = working()
    core.on_done(result(1), 0)
    (ask,) = core.on_time(0)
    assert core.on_reply(ask.request, None, 0) == []
    (ask,) = core.on_time(RETRY_NS)
    _, written = core.on_reply(ask.request, None, RETRY_NS)
    assert written == SpoolWrite(1, pack(result(1), hello()))
    assert core.on_done(result(2), RETRY_NS) == [SpoolWrite(2, pack(result(2), hello()))]
    (ask,) = core.on_time(2 * RETRY_NS)
    effects = core.on_reply(ask.request, reply(seq=2), 2 * RETRY_NS)
    assert SpoolForget(1) in effects
    assert SpoolForget(2) not in effects
    (ask,) = core.on_time(2 * RETRY_NS + IDLE_NS)
    assert SpoolForget(2) in core.on_reply(ask.request, reply(seq=3), 3 * RETRY_NS)
    assert core.spooled == set()


def test_a_worker_that_leaves_unheard_leaves_its_results_in_the_spool():
    core = working()
    core.on_done(result(1), 0)
    core.on_drain("SIGTERM", 0)
    core.reachable = True
    core.unanswered = 0
    now = 0
    effects = []
    for _ in range(GOODBYE_TRIES):
        now = max(now, core.ask_at_ns)
        (ask,) = core.on_time(now)
        effects += core.on_reply(ask.request, None, now)
    (written,) = [e for e in effects if isinstance(e, SpoolWrite)]
    assert written == SpoolWrite(1, pack(result(1), hello()))
    assert effects[-1] == Leave()


def test_a_refused_goodbye_ends_as_well():
    core = working()
    core.on_done(result(1), 0)
    core.on_drain("SIGTERM", 0)
    now = 0
    for _ in range(GOODBYE_TRIES):
        now = max(now, core.ask_at_ns)
        (ask,) = core.on_time(now)
        effects = core.on_reply(ask.request, reply(error="unknown worker, say hello"), now)
    assert effects[-2:] == [SpoolWrite(1, pack(result(1), hello())), Leave()]


def test_results_of_an_earlier_incarnation_are_delivered():
    core = Core(hello())
    torn = pack(result(8), hello())[:-1]
    said = core.on_spool([pack(result(7), hello()), torn, b""])
    assert said == [
        Say("1 results of earlier workers are delivered"),
        Say("2 files of the spool are damaged and ignored"),
    ]
    (ask,) = core.on_time(0)
    core.on_reply(ask.request, reply(), 0)
    (ask,) = core.on_time(0)
    assert (ask.request.results, ask.request.sealed) == ([], [unpack(pack(result(7), hello()))])
    assert SpoolForget(7) in core.on_reply(ask.request, reply(seq=1, fenced=[7]), 1)


def test_the_spool_keeps_a_result_as_it_is():
    kept = Result("c", "x", 5, "verdict", "pass", {"a": 1.5, "b": None}, ["r"], wall_s=2.5)
    sealed = unpack(pack(kept, hello()))
    assert (sealed.token, sealed.worker) == (5, "w")
    assert decode(sealed.result, Result) == kept
    assert is_sealed(signer_of(hello().session), sealed.result, sealed.seal)
    assert unpack(b"") is None
    assert unpack(pack(kept, hello())[1:]) is None


GB = 1_000_000_000


@pytest.mark.parametrize(
    ("limit", "used", "dies"),
    [(None, 99 * GB, False), (4 * GB, 3 * GB, False), (4 * GB, 3 * GB + 1, True)],
)
def test_a_rig_above_its_memory_limit_is_ended(limit, used, dies):
    core = working(tokens=(1,))
    core.memory_max_bytes = limit
    effects = core.on_memory({"simulator": used, "stack": 1 * GB}, 5)
    assert (StopRig() in effects) is dies
    if dies:
        (ended,) = core.ended
        assert ended.reason == "out_of_memory"
        assert ended.detail == (
            "the rig uses 4.00 GB of memory (simulator 3.00, stack 1.00), allowed are 4"
        )


def test_of_several_cases_none_is_charged_for_memory():
    core = working()
    core.memory_max_bytes = GB
    core.on_memory({"stack": 2 * GB}, 5)
    assert [e.reason for e in core.ended] == ["suspect", "suspect"]
    assert core.on_memory({"stack": 2 * GB}, 6) == [], "that rig is gone"


def test_a_worker_that_was_forgotten_leaves_and_keeps_its_results():
    """Silent for so long that its id is dead: what it finished waits in the spool."""
    core = working()
    core.on_done(result(1), 5)
    (ask,) = core.on_time(5)
    core.on_reply(ask.request, reply(error="unknown worker, say hello"), 6)
    (ask,) = core.on_time(6 + IDLE_NS)
    effects = core.on_reply(ask.request, reply(error="worker w has left"), 7 + IDLE_NS)
    assert effects == [
        KeepLogs((lease(2, CASES[1]),), "released: worker w has left"),
        StopRig(),
        SpoolWrite(1, pack(result(1), hello())),
        Leave("worker w has left"),
    ]


def test_a_case_that_stands_still_at_somebodys_wish_is_not_late():
    core = working(slots=1, tokens=(1,))
    core.on_progress([1], [4], 7)
    core.on_progress([1], [4], 4 * SECOND_NS, waiting=[1])
    core.on_time(7 + 5 * SECOND_NS)
    assert core.held
    core.on_time(9 * SECOND_NS)
    assert not core.held


def test_a_touch_is_told_at_once_until_it_is_heard():
    core = working(slots=1, tokens=(1,))
    touch = Touch(40, "pause", 0)
    core.on_intervened(1, touch, 1)
    core.on_intervened(9, touch, 1)  # abandoned meanwhile
    (ask,) = core.on_time(1)
    assert ask.request.touched == {"1": touch}
    core.on_reply(ask.request, None, 1)
    (ask,) = core.on_time(4 * SECOND_NS)
    assert ask.request.touched == {"1": touch}
    later = Touch(41, "resume", 0)
    core.on_intervened(1, later, 4 * SECOND_NS)
    core.on_reply(ask.request, reply(), 4 * SECOND_NS)
    (ask,) = core.on_time(4 * SECOND_NS)
    assert ask.request.touched == {"1": later}, "the first was heard, not the second"
    core.on_reply(ask.request, reply(), 4 * SECOND_NS)
    core.on_progress([1], [9], 7 * SECOND_NS)
    (ask,) = core.on_time(8 * SECOND_NS)
    assert ask.request.touched == {}


def test_a_steered_case_goes_back_uncharged_also_when_it_takes_its_rig_along():
    core = working(slots=2, tokens=(1, 2))
    core.on_intervened_done(result(1), 3, 0)
    core.on_intervened_done(result(1), 3, 0)
    assert [(e.token, e.reason) for e in core.ended] == [(1, "intervened")]
    assert "3 changes, ended with 'pass'" in core.ended[0].detail
    assert core.results == []
    core.on_intervened(2, Touch(5, "pose", 1), 0)
    core.on_rig_died("crash", "signal 11", 0)
    assert core.ended[-1].reason == "intervened"


def test_the_last_words_of_a_stack_are_asked_for_when_it_hangs():
    core = working(tokens=(1,))
    asked = []

    def said():
        asked.append(1)
        return "; the stack's log ends: hm"

    core.on_time(4 * SECOND_NS, said)
    assert not asked
    core.on_time(5 * SECOND_NS, said)
    assert core.ended[0].detail.endswith("at tick 0; the stack's log ends: hm")


def test_a_refused_rig_blames_no_case_however_many_it_has():
    core = working()
    effects = core.on_rig_died("refused", "mine.py has changed", 6)
    assert effects == [StopRig(), Say("rig ended (refused): mine.py has changed")]
    assert [(e.reason, e.detail) for e in core.ended] == [("refused", "mine.py has changed")] * 2


def test_a_spooled_result_counts_only_with_its_own_digest():
    one, other = pack(result(1), hello()), pack(result(2), hello())
    assert [decode(unpack(each).result, Result) for each in (one, other)] == [result(1), result(2)]
    assert unpack(one[:32] + other[32:]) is None
    assert unpack(one[:-1]) is None
    assert unpack(b"") is None


def test_what_ends_while_a_request_is_on_its_way_is_told_with_the_next():
    core, request = joined(slots=2)
    core.on_reply(request, reply(seq=1, leases=[lease(1), lease(2, CASES[1])]), 0)
    core.on_rig_ready()
    core.on_done(result(1), 1)
    (asked,) = core.on_time(1)
    assert [r.token for r in asked.request.results] == [1]
    core.on_rig_died("crash", "signal 9", 2)
    core.on_reply(asked.request, reply(seq=2), 3)
    assert core.results == []
    assert [(end.token, end.reason) for end in core.ended] == [(2, "crash")]
