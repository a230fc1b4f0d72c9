"""The conductor's decisions. No clock, no I/O, no threads: requests in, facts and a reply out.

``decide`` applies each fact to the state it is given as soon as it is made, so that later rules of
the same request see it; the caller commits the facts before it lets the reply out, and folds the
journal anew if the commit fails.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from conductor.core.admit import admit
from conductor.core.control import control
from conductor.core.explain import explain
from conductor.core.facts import (
    Draining,
    EpochRaised,
    Fact,
    Granted,
    Intervention,
    Leased,
    Pinned,
    Replied,
    Shortened,
    Submitted,
    WorkerJoined,
    WorkerLeft,
)
from conductor.core.fold import TOUCH_CHARS_MAX, touch_of
from conductor.core.grant import choose, mismatches
from conductor.core.lease import lost, own, seen, token_of
from conductor.core.searching.growth import grow
from conductor.core.session import UNKNOWN_WORKER, not_its_session, opened, speaker
from conductor.core.settle import (
    DETAIL_CHARS_MAX,
    commit,
    end_attempt,
    end_suspects,
    expire,
    keep_recording,
)
from conductor.core.snapshot import take
from conductor.core.speculate import straggler
from conductor.core.state import CampaignState, CaseState, LiveLease, State, WorkerState
from conductor.core.status import case_page, running, status
from conductor.core.turn import RequestTurn
from schemas import SCHEMA_VERSION
from schemas.case import CASE_VERSION
from schemas.device_class import is_portable, result_class
from schemas.sections.autonomy import SANDBOX
from schemas.wire.control import (
    Beat,
    Bye,
    Control,
    Ended,
    Explain,
    Hello,
    Lease,
    Next,
    Recorded,
    Reply,
    Request,
    Sealed,
    StatusRequest,
    Stop,
    Submit,
)
from schemas.wire.status import ConductorStatus
from twin.fabric.session import SECRET_BYTES, hash_of, proves, signer_of

NAME_CHARS_MAX = 200
"""Longest worker id, host, device class, software digest or tag [characters]."""
TAGS_MAX = 100
"""Most tags of a worker."""
WORKERS_MAX = 10_000
"""Most workers that have joined and not left."""


def start(state: State, lay_before: str = "", epoch_min: int = 0) -> list[Fact]:
    """A start of a conductor on the folder: a new epoch, to be journalled before it listens.

    ``lay_before``: the folder's place before, for a journal that does not say where it lay;
    ``epoch_min``: the least epoch, where a claim in a store decides about it, too.
    """
    turn = RequestTurn(state, 0)
    here, before = state.config.folder, state.folder or lay_before
    moved = before if here and before != here else ""
    epoch = max(state.epoch + 1, epoch_min)
    turn.emit(EpochRaised(epoch=epoch, folder=here, before=moved))
    return turn.facts


def decide(state: State, request: Request, now_ns: int) -> tuple[list[Fact], Reply]:
    """Answer one request; ``state`` is advanced by the facts returned."""
    turn = RequestTurn(state, now_ns)
    expire(turn)
    _forget(turn)
    if request.v != SCHEMA_VERSION:
        error = (
            f"schema version {request.v} given, this conductor speaks {SCHEMA_VERSION}; "
            "install the same version on both sides"
        )
        return turn.facts, turn.reply(error=error)
    reply = _VERBS[type(request)](turn, request)
    grow(turn)
    _snapshot(turn, state.config.snapshot_facts)
    return turn.facts, reply


def tick(state: State, now_ns: int) -> list[Fact]:
    """What happens by itself: leases whose time is over are lost, silent workers are forgotten."""
    turn = RequestTurn(state, now_ns)
    expire(turn)
    _forget(turn)
    grow(turn)
    _snapshot(turn, state.config.snapshot_facts)
    return turn.facts


def _forget(turn: RequestTurn) -> None:
    """Workers that were killed say no goodbye; a conductor that runs for days has many of them."""
    state, now_ns = turn.state, turn.now_ns
    if now_ns - state.looked_ns < state.config.forget_ns // 60:
        return
    state.looked_ns = now_ns
    _forget_silent(turn, state.config.forget_ns, "silent for too long")


def _forget_silent(turn: RequestTurn, silent_ns: int, reason: str) -> None:
    """Forget silent workers without leases; should one come back, it joins again."""
    for name, worker in list(turn.state.workers.items()):
        if not worker.tokens and turn.now_ns - worker.seen_ns >= silent_ns:
            turn.emit(WorkerLeft(worker=name, reason=reason, forgotten=True))


def take_found(state: State, found: Iterable[Sealed], now_ns: int) -> list[Fact]:
    """Results that a successor has found in the store: each counts as if its worker had committed
    it now, so only with a token that this journal has leased to that worker."""
    turn = RequestTurn(state, now_ns)
    for sealed in found:
        if (unsealed := opened(state, sealed)) is not None:
            commit(turn, *unsealed)
    grow(turn)
    return turn.facts


def close(state: State) -> list[Fact]:
    """A clean end: the next start finds a snapshot and hardly any facts after it."""
    turn = RequestTurn(state, 0)
    _snapshot(turn, state.config.snapshot_close_facts)
    return turn.facts


def _snapshot(turn: RequestTurn, facts: int) -> None:
    if turn.state.tail >= facts:
        turn.emit(take(turn.state))


def worker_lost(state: State, worker: str, now_ns: int) -> list[Fact]:
    """The session of ``worker`` vanished: a hint that its leases will not be renewed."""
    turn = RequestTurn(state, now_ns)
    if worker in state.workers:
        turn.emit(Shortened(worker=worker, until_ns=now_ns + state.config.vanished_ns))
    return turn.facts


def _hello(turn: RequestTurn, request: Hello) -> Reply:
    state = turn.state
    # The id becomes part of keys and file names.
    if not 0 < len(request.worker) <= NAME_CHARS_MAX or set("/*$?# \n\t") & set(request.worker):
        return turn.reply(
            error=f"worker id {request.worker[:60]!r}: 1-{NAME_CHARS_MAX} characters, "
            "without / * $ ? # and spaces"
        )
    if error := _oversized(request):
        return turn.reply(error=error)
    if request.case_version != CASE_VERSION:
        return turn.reply(
            error=f"worker {request.worker} reads cases of version {request.case_version}, this "
            f"conductor leases version {CASE_VERSION}; install the same release on both sides"
        )
    if len(request.session) != SECRET_BYTES:
        return turn.reply(
            error=f"worker {request.worker}: a session's secret of {len(request.session)} bytes, "
            f"{SECRET_BYTES} are needed; install the same version on both sides"
        )
    if request.worker in state.departed:
        return turn.reply(error=f"worker {request.worker} has left; a new start needs a new id")
    lacks = dict(request.lacks)
    if not state.config.protected:  # then nobody needs one
        lacks.pop(SANDBOX, None)
    joined = WorkerJoined(
        worker=request.worker,
        host=request.host,
        pid=request.pid,
        device_class=request.device_class,
        software=request.software,
        slots=request.slots,
        walltime_end_s=request.walltime_end_s,
        memory_bytes=request.memory_bytes,
        tags=request.tags,
        share=request.share,
        lacks=lacks,
        plugins=request.plugins,
        session=hash_of(request.session),
        signer=signer_of(request.session),
    )
    known = state.workers.get(request.worker)
    if known is not None and not proves(request.session, known.joined.session):
        return turn.reply(error=not_its_session(request.worker))
    if known is None:
        if len(state.workers) >= WORKERS_MAX:
            _forget_silent(turn, state.config.ttl_ns, "silent, and others want to join")
        if len(state.workers) >= WORKERS_MAX:
            return turn.reply(
                error=f"{len(state.workers)} workers are here and none of them is silent without a "
                f"lease, at most {WORKERS_MAX}; start another conductor with another --state folder"
            )
        turn.emit(joined)
    elif known.joined != joined:
        return turn.reply(
            error=f"worker {request.worker} has joined with other properties; "
            "a new start needs a new id"
        )
    turn.emit(seen(state, request.worker, (), turn.now_ns))
    notes = _notes(mismatches(state, state.workers[request.worker]))
    return turn.reply(status=notes, store=state.config.store)


def _oversized(request: Hello) -> str:
    """What of a worker's properties is too long to be kept, or nothing."""
    words = {
        "host": [request.host],
        "device class": [request.device_class],
        "software digest": [request.software],
        "tag": request.tags,
        "word about what it lacks": [*request.lacks, *request.lacks.values()],
        "plug-in": [*request.plugins, *request.plugins.values()],
    }
    if len(request.lacks) > TAGS_MAX:
        return f"worker {request.worker}: lacks {len(request.lacks)} things, at most {TAGS_MAX}"
    if len(request.plugins) > TAGS_MAX:
        return f"worker {request.worker}: {len(request.plugins)} plug-ins, at most {TAGS_MAX}"
    if len(request.tags) > TAGS_MAX:
        return (
            f"worker {request.worker}: {len(request.tags)} tags, at most {TAGS_MAX}; leave some out"
        )
    for name, texts in words.items():
        for word in texts:
            if len(word) > NAME_CHARS_MAX:
                return (
                    f"worker {request.worker}: a {name} of {len(word)} characters, allowed: "
                    f"{NAME_CHARS_MAX}; give a shorter one"
                )
    return ""


def _next(turn: RequestTurn, request: Next) -> Reply:
    state = turn.state
    worker, error = speaker(state, request)
    if worker is None:
        return turn.reply(error=error)
    if worker.replied is not None and request.seq == worker.replied.seq:
        turn.emit(seen(state, request.worker, worker.tokens, turn.now_ns))
        return _again(state, worker.replied)
    if worker.replied is not None and request.seq < worker.replied.seq:
        return turn.reply(
            error=f"seq {request.seq} is older than {worker.replied.seq}, which has been answered"
        )
    acks = []
    fenced = []
    for result in request.results:
        acks.append(result.token)
        if not commit(turn, result, worker):
            fenced.append(result.token)
    for sealed in request.sealed:
        acks.append(sealed.token)
        unsealed = opened(state, sealed)
        if unsealed is None or not commit(turn, *unsealed):
            fenced.append(sealed.token)
    _end_attempts(turn, request.worker, request.ended)
    # A lease that the worker does not know of was lost on its way there.
    known = set(request.held)
    for lease in own(state, request.worker, [t for t in worker.tokens if t not in known]):
        end_attempt(turn, lease, "released", "the reply with the lease did not arrive")
    held = own(state, request.worker, request.held)
    gone = lost(state, request.worker, request.held)
    grow(turn)
    leases = _grant(turn, request, worker, held)
    turn.emit(
        seen(
            state,
            request.worker,
            worker.tokens,
            turn.now_ns,
            remaining_s=request.remaining_s,
        )
    )
    notes = [] if leases else mismatches(state, worker)
    reply = turn.reply(
        worker,
        seq=request.seq,
        acks=acks,
        fenced=fenced,
        leases=leases,
        lost=gone,
        retry_after_s=_retry_after_s(state, request, leases),
        status=_notes(notes),
    )
    turn.emit(_replied(request, reply))
    return reply


def _replied(request: Next, reply: Reply) -> Replied:
    """Fact of a reply without its cases, which are large and in the journal already."""
    granted = [
        Granted(
            lease.case.variation.campaign, lease.case.id, lease.token, lease.attempt, lease.alone
        )
        for lease in reply.leases
    ]
    bare = msgspec.structs.replace(reply, leases=[]) if granted else reply
    return Replied(worker=request.worker, seq=request.seq, reply=bare, granted=granted)


def _again(state: State, replied: Replied) -> Reply:
    leases = [
        Lease(
            token=granted.token,
            attempt=granted.attempt,
            out=state.campaigns[granted.campaign].out,
            case=state.campaigns[granted.campaign].cases[granted.case].case,
            alone=granted.alone,
        )
        for granted in replied.granted
    ]
    return msgspec.structs.replace(replied.reply, leases=leases) if leases else replied.reply


def _end_attempts(turn: RequestTurn, worker: str, ends: list[Ended]) -> None:
    suspects: dict[int, str] = {}
    for ended in ends:
        for lease in own(turn.state, worker, [ended.token]):
            if lease.key != (ended.campaign, ended.case):
                continue
            if ended.reason == "suspect":
                suspects[lease.token] = ended.detail
            else:
                end_attempt(turn, lease, ended.reason, ended.detail)
    # One rig's cases: a worker has one rig, and tells of its end before it starts another.
    if suspects and (leases := own(turn.state, worker, sorted(suspects))):
        end_suspects(turn, leases, "suspect", suspects[leases[0].token])


def _retry_after_s(state: State, request: Next, leases: list[Lease]) -> float:
    if leases or request.k < 1:
        return 0.0
    return state.config.retry_busy_s if state.left else state.config.retry_idle_s


def _notes(lines: list[str]) -> ConductorStatus:
    return {"notes": lines} if lines else {}


def _grant(
    turn: RequestTurn, request: Next, worker: WorkerState, held: list[LiveLease]
) -> list[Lease]:
    state = turn.state
    leases = []
    for case in choose(state, request, worker, held, turn.now_ns):
        campaign = state.campaigns[case.case.variation.campaign]
        _pin(turn, campaign, worker.joined)
        leases.append(_lease(turn, campaign, case, worker.joined.worker))
    if not leases:
        case_late = straggler(state, request, worker, turn.now_ns)
        if case_late is not None:
            campaign = state.campaigns[case_late.case.variation.campaign]
            leases.append(_lease(turn, campaign, case_late, worker.joined.worker))
    return leases


def _pin(turn: RequestTurn, campaign: CampaignState, worker: WorkerJoined) -> None:
    if not campaign.pinned:
        file = campaign.campaign
        here = result_class(is_portable(file), worker.device_class)
        here = "" if file.device == "any" else here
        turn.emit(Pinned(campaign=file.campaign, software=worker.software, device_class=here))


def _lease(turn: RequestTurn, campaign: CampaignState, case: CaseState, worker: str) -> Lease:
    state = turn.state
    fact = Leased(
        campaign=case.case.variation.campaign,
        case=case.case.id,
        token=token_of(state.epoch, state.granted + 1),
        attempt=case.attempts + 1,
        worker=worker,
        alone=case.alone,
        speculative=bool(case.live),
    )
    turn.emit(fact)
    return Lease(
        token=fact.token, attempt=fact.attempt, out=campaign.out, case=case.case, alone=fact.alone
    )


def _beat(turn: RequestTurn, request: Beat) -> Reply:
    worker, error = speaker(turn.state, request)
    if worker is None:
        return turn.reply(error=error)
    held = {int(token): progress for token, progress in request.held.items()}
    turn.emit(seen(turn.state, request.worker, held, turn.now_ns, held))
    for lease in own(turn.state, request.worker, held):
        touch = request.touched.get(str(lease.token))
        if touch is not None and lease.touched != touch_of(touch):
            turn.emit(
                Intervention(
                    campaign=lease.key[0],
                    case=lease.key[1],
                    token=lease.token,
                    tick=touch.tick,
                    what=touch.what[:TOUCH_CHARS_MAX],
                    changes=touch.changes,
                )
            )
    return turn.reply(worker, lost=lost(turn.state, request.worker, held))


def _bye(turn: RequestTurn, request: Bye) -> Reply:
    worker, error = speaker(turn.state, request)
    if worker is None and error != UNKNOWN_WORKER:
        return turn.reply(error=error)
    if worker is not None:  # or it has left already
        for lease in own(turn.state, request.worker, list(worker.tokens)):
            end_attempt(turn, lease, "released", "the worker left")
        turn.emit(WorkerLeft(worker=request.worker, reason=request.detail[:DETAIL_CHARS_MAX]))
    return turn.reply()


def _recorded(turn: RequestTurn, request: Recorded) -> Reply:
    worker, error = speaker(turn.state, request)
    if worker is not None:
        error = keep_recording(turn, request, worker)
    return turn.reply(error=error)


def _submit(turn: RequestTurn, request: Submit) -> Reply:
    fact, errors = admit(turn.state, request)
    if errors:
        return turn.reply(error="\n".join(errors))
    if fact is not None:
        turn.emit(fact)
    name = str(request.campaign["campaign"])
    campaign = turn.state.campaigns[name]
    return turn.reply(
        status={
            "campaign": name,
            "out": campaign.out,
            "cases": len(campaign.cases),
            "left": campaign.left,
            "digest": campaign.digest,
            "resumed": not isinstance(fact, Submitted),
        }
    )


def _control(turn: RequestTurn, request: Control) -> Reply:
    error, changed = control(turn, request)
    return turn.reply(error=error, status={} if error else {"changed": changed})


def _explain(turn: RequestTurn, request: Explain) -> Reply:
    lines = explain(turn.state, request.campaign, request.case, turn.now_ns)
    if not lines:
        return turn.reply(
            error=f"no case '{request.case[:80]}' of a campaign '{request.campaign[:80]}' here"
        )
    return turn.reply(status={"explain": lines})


def _status(turn: RequestTurn, request: StatusRequest) -> Reply:
    answer = status(turn.state, turn.now_ns)
    if request.running:
        answer["running"] = running(turn.state, turn.now_ns)
    if request.cases:
        campaign = turn.state.campaigns.get(request.cases)
        if campaign is None:
            return turn.reply(error=f"no campaign '{request.cases[:80]}' here")
        answer["page"] = case_page(campaign, request.first)
    return turn.reply(status=answer)


def _stop(turn: RequestTurn, _: Stop) -> Reply:
    if not turn.state.draining:
        turn.emit(Draining())
    return turn.reply()


_VERBS: dict[type[Any], Callable[[RequestTurn, Any], Reply]] = {
    Hello: _hello,
    Next: _next,
    Beat: _beat,
    Bye: _bye,
    Recorded: _recorded,
    Submit: _submit,
    Control: _control,
    Explain: _explain,
    StatusRequest: _status,
    Stop: _stop,
}
