"""Which waiting cases a worker gets.

Campaigns by priority, among equals the one with the fewest cases under way, then in submission
order: for a worker that has a share of the campaign its own share first, and if so configured for
one that begins without a share from all over the campaign. A running rig is refilled with what fits
it, and cases are granted only if they are expected to end within the asker's walltime.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from conductor.core.backlog import GOLDEN, SPREAD_MAX
from conductor.core.facts import SHARED, WorkerJoined
from conductor.core.state import (
    PROTECTED_ONLY,
    CampaignState,
    CaseState,
    Config,
    LiveLease,
    State,
    WorkerState,
)
from schemas.campaign import Campaign, Requirements
from schemas.device_class import is_portable, result_class
from schemas.kinds.perception import perception_kind, perception_lack
from schemas.kinds.plugins import plugin_lack
from schemas.sections.autonomy import SANDBOX
from schemas.sections.view_mode import RECORDER, ViewMode
from schemas.wire.control import Next, Share

URGENT_MAX = 1024
"""Most waiting cases of a lane among which the longest are looked for."""


def mismatch(campaign: CampaignState, state: WorkerState) -> str:
    """Why a worker may not run ``campaign``, in one line; empty if it may."""
    name, worker = campaign.campaign.campaign, state.joined
    if name in state.refused:
        return (
            f"{worker.worker}: {state.refused[name]}; it gets no case of campaign '{name}' "
            "until it is started again"
        )
    if campaign.pinned and campaign.software != worker.software:
        return (
            f"{worker.worker}: software {worker.software[:12]} is not the {campaign.software[:12]} "
            f"that campaign '{name}' began with; it gets no case of it, install the same version"
        )
    here = result_class(is_portable(campaign.campaign), worker.device_class)
    if campaign.device_class and campaign.device_class != here:
        return (
            f"{worker.worker}: device class {here} is not the "
            f"{campaign.device_class} that campaign '{name}' began with; it gets no case of it, "
            "submit with 'device: any' to mix device classes"
        )
    lacks = _lacks(campaign.campaign.requires, worker) or _bridgeless(campaign, worker)
    lacks = lacks or _unprotected(campaign, worker) or _pluginless(campaign.campaign, worker)
    lacks = lacks or _recorderless(campaign.campaign, worker) or _blind(campaign, worker)
    if lacks:
        return f"{worker.worker}: {lacks}; it gets no case of campaign '{name}'"
    return ""


def _lacks(requires: Requirements, worker: WorkerJoined) -> str:
    """What ``worker`` does not offer, or nothing."""
    kind = worker.device_class.partition(":")[0]
    if requires.device not in ("any", kind):
        return f"simulates on {kind}, required is {requires.device}"
    if worker.memory_bytes is not None and worker.memory_bytes < int(requires.memory_gb * 1e9):
        return (
            f"allows a rig {worker.memory_bytes / 1e9:g} GB of memory, "
            f"required are {requires.memory_gb:g} GB"
        )
    missing = [tag for tag in requires.tags if tag not in worker.tags]
    return f"has not the tag {', '.join(missing)}" if missing else ""


def _bridgeless(campaign: CampaignState, worker: WorkerJoined) -> str:
    """What the campaign's bridge needs and the worker has not, or nothing."""
    autonomy = campaign.campaign.autonomy
    if autonomy.placement != "worker":
        return ""
    lack = worker.lacks.get(autonomy.bridge, "")
    return f"cannot run the bridge '{autonomy.bridge}', {lack}" if lack else ""


def _blind(campaign: CampaignState, worker: WorkerJoined) -> str:
    """The first perception variant that the worker cannot run, or nothing."""
    autonomy = campaign.campaign.autonomy
    if autonomy.placement == "node":  # the stack runs on another host
        return ""
    for name, variant in autonomy.perception.items():
        if lack := worker.lacks.get(perception_lack(perception_kind(variant).name), ""):
            return f"cannot run the perception '{name}', {lack}"
    return ""


def _unprotected(campaign: CampaignState, worker: WorkerJoined) -> str:
    """Why a worker has no sandbox for the campaign's stack, if that matters; or nothing."""
    lack = worker.lacks.get(SANDBOX, "")
    if not lack or campaign.campaign.autonomy.placement != "worker":
        return ""
    return f"has no sandbox for stacks, {lack}; {PROTECTED_ONLY}"


def _recorderless(campaign: Campaign, worker: WorkerJoined) -> str:
    """Why a worker does not record, where the campaign asks for recordings; or nothing."""
    lack = worker.lacks.get(RECORDER, "")
    asked = ViewMode(campaign.view).records and campaign.recording.keep != "none"
    if not lack or not asked:
        return ""
    return f"writes no recordings (view: {campaign.view}), {lack}"


def _pluginless(campaign: Campaign, worker: WorkerJoined) -> str:
    """The first plug-in that the campaign uses and the worker has not as it is here, or nothing."""
    for name, version in campaign.plugins.items():
        needed = f"plug-in '{name}' {version}"
        if name not in worker.plugins:
            return f"has no {needed}; install it there"
        if worker.plugins[name] != version:
            return f"has plug-in '{name}' {worker.plugins[name]}, needed is {version}"
        if lack := worker.lacks.get(plugin_lack(name), ""):
            return f"cannot use {needed}, {lack}"
    return ""


def mismatches(state: State, worker: WorkerState) -> list[str]:
    """One line per unfinished campaign that ``worker`` may not run."""
    lines = (mismatch(campaign, worker) for campaign in state.campaigns.values() if campaign.left)
    return [line for line in lines if line]


def choose(
    state: State, request: Next, worker: WorkerState, held: Sequence[LiveLease], now_ns: int
) -> list[CaseState]:
    """The cases to lease now: one rig key, at most ``request.k``; a case that runs alone is alone.

    Args:
        state: after the request's results and released leases were applied.
        request: what the worker asks for.
        worker: the asker.
        held: its live leases.
        now_ns: the time [ns].
    """
    count = min(request.k, state.config.leases_max)
    if (
        state.draining
        or worker.draining
        or count < 1
        or not state.left
        or any(lease.alone for lease in held)
    ):
        return []
    asker = Asker(state, request, worker, now_ns)
    ranked = sorted((c for c in state.campaigns.values() if asker.may_run(c)), key=rank)
    if request.held:
        return _refill(asker, ranked, held, count)
    first = _sticky(asker, ranked) if request.rig else None
    if first is None:
        first = next((hit for c in ranked if (hit := asker.first(c, None)) is not None), None)
    if first is None:
        return []
    return [first] if first.alone else _fill(asker, ranked, first.rig, first.group, count)


def rank(campaign: CampaignState) -> tuple[int, int, int]:
    """Priority, then fewest cases under way, then submission order."""
    return -campaign.priority, campaign.leased, campaign.order


@dataclass(frozen=True, slots=True)
class Asker:
    """A worker that asks for cases, and what it may have."""

    state: State
    request: Next
    worker: WorkerState
    now_ns: int

    def may_run(self, campaign: CampaignState) -> bool:
        """Cases of the campaign wait, and nothing about this worker forbids them."""
        return (
            bool(len(campaign.backlog))
            and not campaign.paused
            and not mismatch(campaign, self.worker)
            and not shunned(self.state, campaign, self.worker, self.now_ns)
            and fits(self.state.config, campaign, self.request.remaining_s)
        )

    def first(self, campaign: CampaignState, rig: str | None) -> CaseState | None:
        """The first waiting case that it may have; ``rig`` None: of any rig key."""
        position = campaign.backlog.first(
            rig, lambda order: self.usable(campaign, campaign.ordered[order])
        )
        return campaign.ordered[position[0]] if position is not None else None

    def usable(self, campaign: CampaignState, case: CaseState) -> bool:
        """The case's batch is open, and no other worker should try it instead."""
        if self.state.config.by_batch and case.case.variation.batch != campaign.lowest_batch():
            return False
        return not case.charges or not avoids(self.state, campaign, case, self.worker, self.now_ns)


def avoids(
    state: State, campaign: CampaignState, case: CaseState, worker: WorkerState, now_ns: int
) -> bool:
    """The last charge must not come from the worker of all others, while there is another one.

    Otherwise one broken node would put good cases into quarantine.
    """
    name = worker.joined.worker
    if len(case.charges) + 1 < campaign.campaign.attempts_max:
        return False
    if any(charge.worker != name for charge in case.charges):
        return False
    return any(
        other is not worker
        and not shunned(state, campaign, other, now_ns)
        and fits(state.config, campaign, other.remaining_s)
        for other in _able(state, campaign, now_ns)
    )


def shunned(state: State, campaign: CampaignState, worker: WorkerState, now_ns: int) -> bool:
    """Whether its host is broken, it seems, and a worker of another host can run the campaign
    instead."""
    host = worker.joined.host
    return broken(state, host) and any(
        other.joined.host != host and not broken(state, other.joined.host)
        for other in _able(state, campaign, now_ns)
    )


def broken(state: State, host: str) -> bool:
    """Different cases died on ``host``, one after the other, and none was committed in between."""
    return len(state.deaths.get(host, ())) >= state.config.host_deaths


def _able(state: State, campaign: CampaignState, now_ns: int) -> Iterator[WorkerState]:
    """Workers that are here and may run the campaign."""
    for worker in state.workers.values():
        if (
            not worker.draining
            and present(state, worker, now_ns)
            and not mismatch(campaign, worker)
        ):
            yield worker


def present(state: State, worker: WorkerState, now_ns: int) -> bool:
    """Whether a worker spoke within a time to live; a silent worker is still welcome when it comes
    back."""
    return not worker.vanished and now_ns - worker.seen_ns < state.config.ttl_ns


def fits(config: Config, campaign: CampaignState, remaining_s: float | None) -> bool:
    """Whether a case ends before the asker's walltime, as far as is known."""
    if remaining_s is None:
        return True
    estimate_s = campaign.durations.p95_s() or 0.0
    return estimate_s + config.walltime_margin_s < remaining_s


def _refill(
    asker: Asker, ranked: Sequence[CampaignState], held: Sequence[LiveLease], count: int
) -> list[CaseState]:
    """The rig is running: only cases that fit it, unless others are due to have it."""
    case = asker.state.case(held[0].key) if held else None
    rig = case.rig if case else asker.request.rig
    group = held[0].group if held else SHARED
    if group == SHARED and _must_yield(asker, ranked, rig, held):
        return []
    return _fill(asker, ranked, rig, group, count)


def _sticky(asker: Asker, ranked: Sequence[CampaignState]) -> CaseState | None:
    """A case that spares an idle rig the restart."""
    rig = asker.request.rig
    if _must_yield(asker, ranked, rig, ()):
        return None
    return next((hit for c in ranked if (hit := asker.first(c, rig)) is not None), None)


def _must_yield(
    asker: Asker, ranked: Sequence[CampaignState], rig: str, held: Sequence[LiveLease]
) -> bool:
    """Whether the rig should run dry for a campaign that it does not fit.

    One of a higher priority is due; among equals, one that would still have fewer cases under way
    with this worker than the others without it.
    """
    if len(ranked) < 2:
        return False
    best = next((c for c in ranked if rig in c.backlog.lanes), None)
    if best is None:
        return False
    held_of_best = sum(lease.key[0] == best.campaign.campaign for lease in held)
    slots = asker.worker.joined.slots
    for other in ranked:
        if other is best or rig in other.backlog.lanes or other.priority < best.priority:
            continue
        due = other.priority > best.priority or other.leased + slots <= best.leased - held_of_best
        if due and asker.first(other, None) is not None:
            return True
    return False


def _fill(
    asker: Asker, ranked: Sequence[CampaignState], rig: str, group: int, count: int
) -> list[CaseState]:
    """Cases of one lane, up to ``count``, each from the campaign that is due."""
    cases: list[CaseState] = []
    lanes = [(rank(c), c, _lane(asker, c, rig, group, count)) for c in ranked]
    heap = [(place, index) for index, (place, _, _) in enumerate(lanes)]
    heapq.heapify(heap)
    while heap and len(cases) < count:
        (priority, leased, order), index = heap[0]
        _, campaign, lane = lanes[index]
        position = next(lane, None)
        # Nothing but a later batch keeps a case of such a lane from the asker, for charged cases
        # run alone. With batches lanes are in submission order: the rest is later still.
        if position is None or not asker.usable(campaign, campaign.ordered[position]):
            heapq.heappop(heap)
            continue
        cases.append(campaign.ordered[position])
        heapq.heapreplace(heap, ((priority, leased + 1, order), index))
    return cases


def _lane(asker: Asker, campaign: CampaignState, rig: str, group: int, count: int) -> Iterator[int]:
    """Waiting cases of one lane as the asker would like to have ``count`` of them."""
    config, share = asker.state.config, asker.worker.joined.share
    if group == SHARED and not config.by_batch:
        urgency = _urgency(campaign) if config.longest_first else None
        if share is not None:
            return _preferred(campaign, share, rig, count, urgency)
        mixed = config.spread and not asker.request.held and count > 1
        if urgency is not None:
            return _urgent(campaign.backlog.take(rig, group), count, urgency, mixed=mixed)
        if mixed:
            return iter(campaign.backlog.mixed(rig, group, count))
    return campaign.backlog.take(rig, group)


def _urgency(campaign: CampaignState) -> Callable[[int], float] | None:
    """Orders cases, the smallest first: the longest of what is expected, or as long as nothing is
    known those of the pilot; None: neither tells cases apart."""
    lengths = campaign.lengths
    if lengths.told:
        return lambda order: -lengths.expected_s(order)
    pilot = {order for order in lengths.pilot if campaign.ordered[order].waits}
    return (lambda order: float(order not in pilot)) if pilot else None


def _urgent(
    lane: Iterator[int], count: int, urgency: Callable[[int], float], *, mixed: bool
) -> Iterator[int]:
    """Positions by urgency, at most ``count``; among equals from all over the lane if ``mixed``,
    else in order."""

    def place(order: int) -> tuple[float, float]:
        return urgency(order), order * GOLDEN % 1.0 if mixed else order

    return iter(heapq.nsmallest(count, islice(lane, URGENT_MAX), key=place))


def _preferred(
    campaign: CampaignState,
    share: Share,
    rig: str,
    count: int,
    urgency: Callable[[int], float] | None = None,
) -> Iterator[int]:
    """Positions of cases, at most ``count``: of the share, then of the rest of its stretch, and so
    on from stretch to stretch; of each the most urgent first."""
    cases, stretches, devices = len(campaign.ordered), share.stretches, share.devices

    def strangeness(order: int) -> tuple[int, bool, float]:
        stretch = order * stretches // cases
        dealt_to = int(order * GOLDEN % 1.0 * devices)  # however long the axes of a matrix are
        strange = (stretch - share.stretch) % stretches, dealt_to != share.device
        return *strange, 0.0 if urgency is None else urgency(order)

    begin = -(-share.stretch * cases // stretches)
    looked_at = min(4 * count * devices, SPREAD_MAX)
    if urgency is not None:
        looked_at = max(looked_at, URGENT_MAX)
    candidates = islice(campaign.backlog.take(rig, SHARED, begin), looked_at)
    return iter(heapq.nsmallest(count, candidates, key=strangeness))
