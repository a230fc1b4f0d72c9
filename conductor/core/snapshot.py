"""The state as images: what a restart reads instead of every fact since the beginning.

A campaign's cases are imaged a thousand at a time, and only those that changed since the latest
snapshot: its cost depends on what has happened, not on how large the campaign is. So are the cases
that a search has proposed since it began.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import msgspec
from msgspec import Struct

from conductor.core.backlog import Backlog
from conductor.core.case_table import pack
from conductor.core.facts import (
    Charge,
    Image,
    LateAttempt,
    Snapshot,
    SteeredAttempt,
    Submitted,
    WorkerJoined,
)
from conductor.core.searching.images import (
    begun_cases,
    is_proposed,
    proposed_images,
    restore_proposed,
)
from conductor.core.state import (
    IMAGE_CASES,
    CampaignState,
    CaseState,
    Issued,
    LiveLease,
    State,
    WorkerState,
)
from schemas.files.recording import RecordingObject


class _Head(Struct, frozen=True):
    """Everything but the cases."""

    epoch: int
    granted: int
    groups: int
    campaigns: dict[str, _CampaignHead]
    workers: list[_WorkerHead]
    departed: list[str]
    leases: list[_LeaseHead]
    deaths: dict[str, tuple[tuple[str, str], ...]] = {}
    folder: str = ""


class _CampaignHead(Struct, frozen=True, array_like=True):
    paused: bool
    pinned: bool
    software: str
    device_class: str
    ended: dict[str, int]
    attempts: int
    disagreements: int
    durations: dict[int, int]


class _WorkerHead(Struct, frozen=True, array_like=True):
    joined: WorkerJoined
    tokens: list[int]
    draining: bool
    refused: dict[str, str] = {}


class _LeaseHead(Struct, frozen=True, array_like=True):
    token: int
    campaign: str
    case: str
    worker: str
    attempt: int
    group: int
    speculative: bool
    touched: str = ""


class _CaseRow(Struct, frozen=True, array_like=True):
    order: int
    group: int
    paused: bool
    issued: tuple[Issued | int, ...]
    """Earlier versions kept the tokens alone."""
    live: tuple[int, ...]
    charges: tuple[Charge, ...]
    losses: tuple[Charge, ...]
    lost: tuple[str, ...]
    sealed: bytes
    late: tuple[LateAttempt, ...]
    steered: tuple[SteeredAttempt, ...] = ()
    attempts: int = 0
    lost_times: int = 0
    recording: RecordingObject | None = None


class _Cases(Struct, frozen=True):
    """Cases of one campaign that differ from new ones."""

    campaign: str
    rows: list[_CaseRow]


_encode = msgspec.msgpack.Encoder().encode
HEAD = "0"
"""Key of the head; keys sort in the order in which images are restored."""


def take(state: State) -> Snapshot:
    """Images of all that changed since the latest snapshot."""
    images = [Image(HEAD, _encode(_head(state)))]
    for campaign in state.campaigns.values():
        brought = submitted_again(campaign) if campaign.grown else campaign.submitted
        if brought is not None:
            images.append(Image(f"1/{campaign.order:06d}", _encode(brought)))
        if campaign.grown:
            images += proposed_images(campaign)
    for name, chunk in sorted(state.dirty):
        first = chunk * IMAGE_CASES
        cases = state.campaigns[name].ordered[first : first + IMAGE_CASES]
        rows = [_row(case) for case in cases if _changed(case)]
        images.append(Image(f"2/{name}/{chunk:06d}", _encode(_Cases(name, rows))))
    return Snapshot(images=images)


def submitted_again(campaign: CampaignState) -> Submitted:
    """The fact that would bring a campaign as it is now, for the next snapshot; of a search, with
    the cases with which it began."""
    return Submitted(
        campaign=msgspec.to_builtins(campaign.campaign),
        cases=pack([case.case for case in campaign.ordered[: begun_cases(campaign)]]),
        digest=campaign.digest,
        digests=campaign.digests,
        out=campaign.out,
        priority=campaign.priority,
        search=campaign.search,
    )


def restore(state: State, snapshot: Snapshot, submit: Any) -> None:
    """Fill an empty state; ``submit`` folds a :class:`Submitted`.

    Raises:
        msgspec.MsgspecError: an image is damaged.
    """
    head = None
    for image in sorted(snapshot.images, key=lambda image: image.key):
        if image.key == HEAD:
            head = msgspec.msgpack.decode(image.data, type=_Head)
        elif is_proposed(image):
            restore_proposed(state, image)
        elif image.key.startswith("1/"):
            submit(state, msgspec.msgpack.decode(image.data, type=Submitted))
        else:
            _restore_cases(state, msgspec.msgpack.decode(image.data, type=_Cases))
    if head is None:
        raise AssertionError("a snapshot without its head")
    _restore_head(state, head)


def _head(state: State) -> _Head:
    return _Head(
        epoch=state.epoch,
        granted=state.granted,
        groups=state.groups,
        campaigns={name: _campaign_head(c) for name, c in state.campaigns.items()},
        workers=[
            _WorkerHead(worker.joined, list(worker.tokens), worker.draining, worker.refused)
            for worker in state.workers.values()
        ],
        departed=list(state.departed),
        leases=[
            _LeaseHead(x.token, *x.key, x.worker, x.attempt, x.group, x.speculative, x.touched)
            for x in state.leases.values()
        ],
        deaths=state.deaths,
        folder=state.folder,
    )


def _campaign_head(campaign: CampaignState) -> _CampaignHead:
    return _CampaignHead(
        campaign.paused,
        campaign.pinned,
        campaign.software,
        campaign.device_class,
        campaign.ended,
        campaign.attempts,
        campaign.disagreements,
        campaign.durations.counts,
    )


def _changed(case: CaseState) -> bool:
    return bool(case.attempts or case.sealed or case.paused)


def _row(case: CaseState) -> _CaseRow:
    return _CaseRow(
        case.order,
        case.group,
        case.paused,
        case.issued,
        case.live,
        case.charges,
        case.losses,
        case.lost,
        case.sealed,
        case.late,
        case.steered,
        case.attempts,
        case.lost_times,
        case.recording,
    )


def _restore_cases(state: State, image: _Cases) -> None:
    ordered = state.campaigns[image.campaign].ordered
    for row in image.rows:
        case = ordered[row.order]
        case.group, case.paused = row.group, row.paused
        case.issued, case.live = _issued(row.issued), row.live
        case.charges, case.losses, case.lost = row.charges, row.losses, row.lost
        case.sealed, case.late, case.steered = row.sealed, row.late, row.steered
        case.recording = row.recording
        # Rows from before these numbers were kept name every one.
        case.attempts = row.attempts or len(row.issued)
        case.lost_times = row.lost_times or len(row.lost)


def _issued(rows: tuple[Issued | int, ...]) -> tuple[Issued, ...]:
    return tuple(Issued(row, 0, b"") if isinstance(row, int) else row for row in rows)


def _restore_head(state: State, head: _Head) -> None:
    state.epoch, state.granted, state.groups = head.epoch, head.granted, head.groups
    state.folder = head.folder
    state.departed = dict.fromkeys(head.departed)
    state.deaths = dict(head.deaths)
    for campaign in state.campaigns.values():
        campaign.submitted, campaign.grown = None, False
    state.workers = {
        worker.joined.worker: WorkerState(
            joined=worker.joined,
            tokens=dict.fromkeys(worker.tokens),
            draining=worker.draining,
            refused=dict(worker.refused),
        )
        for worker in head.workers
    }
    state.leases = {
        x.token: LiveLease(
            x.token, (x.campaign, x.case), x.worker, x.attempt, x.group, x.speculative, x.touched
        )
        for x in head.leases
    }
    for name, campaign_head in head.campaigns.items():
        _restore_campaign(state.campaigns[name], campaign_head)
    state.left = sum(campaign.left for campaign in state.campaigns.values())


def _restore_campaign(campaign: CampaignState, head: _CampaignHead) -> None:
    campaign.paused, campaign.pinned = head.paused, head.pinned
    campaign.software, campaign.device_class = head.software, head.device_class
    campaign.ended, campaign.attempts = dict(head.ended), head.attempts
    campaign.disagreements = head.disagreements
    campaign.durations.counts = dict(head.durations)
    campaign.durations.total = sum(head.durations.values())
    unended = [case for case in campaign.ordered if not case.ended]
    campaign.left = len(unended)
    campaign.leased = sum(bool(case.live) for case in unended)
    campaign.open_batches = dict(Counter(case.case.variation.batch for case in unended))
    lanes: dict[tuple[str, int], list[int]] = {}
    for case in unended:
        if case.waits:
            lanes.setdefault((case.rig, case.group), []).append(case.order)
    campaign.backlog = Backlog()
    for (rig, group), orders in lanes.items():
        campaign.backlog.extend(rig, orders, group)
