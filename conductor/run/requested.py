"""What is asked of a run, and a run made ready: for `conductor run`, and for programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import UNSET

from conductor.run.changes import NO_CHANGES, CampaignChanges
from conductor.run.gpu_sharing import side_by_side
from conductor.run.gpu_turns import turns
from conductor.run.models import check_models, models_checked
from conductor.run.places import parse_workers, where
from conductor.run.source import chosen, load, with_drive
from schemas.campaign import Campaign
from schemas.kinds.bridge import bridges
from schemas.plan import Plan
from schemas.sections.view_mode import ViewMode
from twin.base.errors import UsageError
from twin.base.process import keep_to_itself
from twin.fabric.endpoint import LOOPBACK

if TYPE_CHECKING:
    from conductor.run.command import RunOptions
    from conductor.run.local_workers import LocalWorkers
    from conductor.stored.link import StoreOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """A run that somebody asks for; the defaults are those of `conductor run`."""

    campaign: str
    """Shipped campaign or path of a campaign file."""
    changes: CampaignChanges = NO_CHANGES
    out: Path | None = None
    """Campaign folder; None: ``runs/CAMPAIGN``."""
    workers: str | None = None
    """A number, ``cuda`` or ``4xcuda``; None: by the cores."""
    slots: int | None = None
    """Cases together per worker; None: as many as are useful."""
    device: str = "cpu"
    seed: int | None = None
    case: str = ""
    """Only this case."""
    cases: int | None = None
    """Only so many, the first."""
    rows: str = ""
    quick: bool = False
    weather: str = ""
    by_batch: bool = False
    history: Path | None = None
    listen: str = LOOPBACK
    view: ViewMode | None = None
    record_drive: bool = False
    render: bool | None = None
    memory_gb: float | None = None
    store: StoreOptions | None = None
    json: bool = False
    searches: bool = False
    """Whether it has to be a search."""


@dataclass(frozen=True, slots=True)
class ReadyRun:
    """A campaign that was checked, with workers that load: what
    :func:`conductor.run.command.carry_out` takes."""

    plan: Plan
    options: RunOptions
    workers: LocalWorkers
    computed: Callable[[], None]


@contextmanager
def made_ready(request: RunRequest) -> Iterator[ReadyRun]:
    """Check what is asked for and start its workers; they have ended when the block has.

    Raises:
        UsageError: it cannot be run; one line per mistake.
        InfrastructureError: it could not be checked.
    """
    plan = _plan(request)
    alone = _runs_alone(plan.campaign)
    workers = "1" if request.workers is None and alone else request.workers
    asked, device = where(parse_workers(workers), request.device)
    with ExitStack() as at_end:
        computed = at_end.enter_context(side_by_side(device))
        at_end.enter_context(turns(device))
        with models_checked(plan, request.campaign, device):
            # Here: importing it takes nearly as long as loading a network.
            from conductor.run.command import RunOptions, local_workers

            # Their rigs differ, but not in how many cases the stack drives.
            drives_one = any(case.rig.slots_of(2) == 1 for case in plan.cases[:1])
            single = (alone or drives_one) and not asked.per_gpu
            options = RunOptions(
                out=request.out or Path("runs") / plan.campaign.campaign,
                workers=asked,
                slots=1 if request.slots is None and single else request.slots,
                device=device,
                by_batch=request.by_batch,
                history=request.history,
                listen=request.listen,
                view=request.view,
                memory_gb=request.memory_gb,
                store=request.store,
                json=request.json,
            )
            keep_to_itself()  # keys and sessions are nothing for a stack of the same user
            local = local_workers(plan, options)
            at_end.callback(local.stop)
        yield ReadyRun(plan, options, local, computed)


def checked_plan(
    campaign: str,
    *,
    seed: int | None = None,
    fetch: bool = True,
    weather: str = "",
    changes: CampaignChanges = NO_CHANGES,
) -> Plan:
    """The plan of a campaign whose networks were looked at, too; arguments as those of
    :func:`conductor.run.source.load`.

    Raises:
        UsageError: one line per mistake.
        InfrastructureError: the check itself did not work.
    """
    plan = load(campaign, seed=seed, fetch=fetch, weather=weather, changes=changes)
    check_models(plan, campaign)
    return plan


def _plan(request: RunRequest) -> Plan:
    loadable = load(
        request.campaign,
        seed=request.seed,
        render=request.render,
        weather=request.weather,
        changes=request.changes,
    )
    if request.searches and loadable.campaign.search is UNSET:
        raise UsageError(
            f"{request.campaign}: has no section `search`, so nothing is searched; run it, or give "
            "it one as docs/search.md says"
        )
    plan = chosen(loadable, request.case, request.cases, request.rows, quick=request.quick)
    return with_drive(plan) if request.record_drive else plan


def _runs_alone(campaign: Campaign) -> bool:
    """Whether two workers of it would take the processor from each other, or wait for each other at
    the port of their scripts or for nodes that somebody else starts once."""
    bridge = bridges().get(campaign.autonomy.bridge)
    if bridge is not None and (bridge.port > 0 or not campaign.autonomy.command):
        return True
    return campaign.clock == "realtime"
