"""What ``hpc submit --on`` and ``hpc scale`` do: one campaign on several clusters."""

from __future__ import annotations

import re
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from hpc.backends import backend
from hpc.campaigns import CampaignFacts
from hpc.commands import at, call
from hpc.request import JobRequest
from hpc.sites import conductor
from hpc.sites.allocations import Allocations, alone, book_of
from hpc.sites.file import NamedSite, SitesFile, load_sites
from hpc.sites.requests import (
    FOLDER_NAME,
    CommonOptions,
    check_campaign,
    request_of,
    with_store,
)
from hpc.sites.scaler import Scaler, is_complete
from hpc.sites.scaling import SiteRoom, WorkerTarget
from schemas.files.allocations import Allocation
from schemas.words import counted
from twin.base.errors import (
    EXIT_INFRASTRUCTURE,
    EXIT_PASS,
    InfrastructureError,
    TwinError,
    UnreachableError,
    UsageError,
    storage_error,
)
from twin.base.files import write_atomic
from twin.fabric.discovery import Target as Conductor
from twin.fabric.keys.key_file import read_private

WORKERS_MAX = 100_000
"""Most workers that a target may name."""
ASKED_BY_HAND = "asked for by `hpc submit`"
"""Why the first allocation of each site is there."""

_TARGET = re.compile(r"([0-9]{1,6}):([0-9]{1,6})")


def parse_target(text: str) -> tuple[int, int]:
    """``MIN:MAX`` workers.

    Raises:
        UsageError: it is something else.
    """
    match = _TARGET.fullmatch(text)
    least, most = (int(match[1]), int(match[2])) if match else (1, 0)
    if not least <= most <= WORKERS_MAX or most == 0:
        raise UsageError(
            f"--target {text!r}: expected MIN:MAX workers, e.g. 0:32, at most {WORKERS_MAX}"
        )
    return least, most


def submit_on(
    facts: CampaignFacts,
    sites: list[NamedSite],
    *,
    file: SitesFile,
    out: Path,
    common: CommonOptions,
    history: str = "",
    say: Callable[[str], None],
) -> int:
    """Serve the campaign on this host and ask each site for an allocation; the exit code.

    Raises:
        TwinError: nothing could be asked for; the line says why.
    """
    check_campaign(facts, file.store)
    common = replace(common, store=file.store)  # to try scripts with; a run's own is below it
    if is_complete(out) and conductor.serving(out) is None:
        say(f"every case has ended: `conductor report {shlex.quote(str(out))}`")
        return EXIT_PASS
    for site in sites:  # before anything is started or left behind
        if not site.entry.dials_out:
            _try(site, facts.name, out, site.entry.connect or file.listen, common)
    with alone(out):
        common = with_store(common, file.store, out)
        served = conductor.serving(out)
        if served is None:
            served = conductor.start(out, facts.name, file.listen, history, common.store)
            say(f"conductor of {out} at {served.endpoint}; it says what it does in conductor.log")
            if common.store:
                say(f"results also in {common.store}: `conductor report {common.store}`")
        book = opened(out, facts.name, all_of(out, sites, file), served, common)
        refused = 0
        for site in sites:
            if site.entry.dials_out:
                say(_by_hand(out, site, served, common))
                continue
            there = [each for each in book.open if each.site == site.name]
            try:
                made = _first(book, site, there)
            except TwinError as error:
                refused += 1
                say(f"{site.name}: {error}")
                continue
            workers = counted(made.workers, "worker")
            say(f"{made.id}: {site.scheduler} job {made.job} with {workers}")
        if refused == len(sites):
            raise InfrastructureError(
                f"no site took an allocation, see above; the conductor waits: `hpc cancel {out}` "
                "ends it"
            )
    return EXIT_PASS if not refused else EXIT_INFRASTRUCTURE


def _try(site: NamedSite, campaign: str, out: Path, connect: str, common: CommonOptions) -> None:
    """Write the script of an allocation, only to see whether it can be written."""
    request = request_of(
        site, f"{site.name}-1", campaign=campaign, out=out, connect=connect, common=common
    )
    with at(site.place):
        backend(site.scheduler).render(request)


def _first(book: Allocations, site: NamedSite, there: list[Allocation]) -> Allocation:
    """The allocation that a site has; one is asked for where there is none."""
    book.refresh(set(), time.time())
    there = [each for each in there if each.state != "ended"]
    for each in there:
        if not each.job:
            book.submit(each, time.time())
        return each
    return book.ask(site, ASKED_BY_HAND, time.time())


def scale(
    out: Path,
    sites: list[NamedSite],
    *,
    file: SitesFile,
    key: Path | None,
    target: WorkerTarget,
    common: CommonOptions,
    period_s: float,
    dry_run: bool,
    once: bool,
    say: Callable[[str], None],
) -> int:
    """Keep as many workers as the run needs; the exit code.

    Raises:
        TwinError: it cannot begin.
    """
    if is_complete(out):
        say("every case has ended")
        return EXIT_PASS
    common = replace(common, store=file.store)  # to try scripts with; a run's own is below it
    for site in sites:  # before anybody is asked anything
        _try(site, out.name, out, site.entry.connect or file.listen, common)
    if key is None and not out.is_dir():
        raise UsageError(
            f"{out}: no such run folder; `hpc submit CAMPAIGN --on ...` makes one, --key names a "
            "conductor elsewhere"
        )
    look = partial(_served, out) if key is None else partial(conductor.target_of, key)
    served = look()
    with alone(out):
        common = with_store(common, file.store, out)
        known = book_of(out)
        campaign = known.campaign if known is not None else out.name
        book = opened(out, campaign, all_of(out, sites, file), served, common, key)
        rooms = {site.name: _room(book, site) for site in sites}
        slots = common.slots or 1
        scaler = Scaler(book, lambda: conductor.status(look()), target, rooms, say, slots, dry_run)
        return scaler.run(period_s, once=once)


def all_of(out: Path, chosen: list[NamedSite], file: SitesFile) -> list[NamedSite]:
    """The sites that were chosen, then those that have allocations of the run already: nothing
    more is asked of them, but they are looked at, and theirs are ended."""
    known = book_of(out)
    names = {site.name for site in chosen}
    others = [
        NamedSite(name, file.sites[name].scheduler, file.sites[name])
        for name in (known.sites if known is not None else ())
        if name in file.sites and name not in names
    ]
    return [*chosen, *others]


def _served(out: Path) -> Conductor:
    served = conductor.serving(out)
    if served is None:
        raise UnreachableError(
            f"{out}: no conductor serves it; `hpc submit CAMPAIGN --on ... --out {out}` starts one"
        )
    return served


def _room(book: Allocations, site: NamedSite) -> SiteRoom:
    request = book.request(site, f"{site.name}-1")
    return SiteRoom(
        site.name,
        request.worker_count,
        site.entry.allocations,
        site.entry.queued,
        walltime_h=request.walltime_min / 60,
    )


def opened(
    out: Path,
    campaign: str,
    sites: list[NamedSite],
    served: Conductor,
    common: CommonOptions,
    key: Path | None = None,
) -> Allocations:
    """The book of a run whose workers join ``served``, with copies of ``key`` if one was given.

    Raises:
        UsageError: it is damaged, or of another campaign.
    """

    def connect_of(site: NamedSite) -> str:
        return site.entry.connect or served.endpoint

    def key_of(site: NamedSite) -> bytes:
        if key is not None:
            return read_private(key)
        return conductor.invitation(out, connect_of(site), served.namespace)

    def request(site: NamedSite, allocation: str, run: str) -> JobRequest:
        connect = connect_of(site)
        return request_of(
            site, allocation, campaign=campaign, out=out, connect=connect, common=common, run=run
        )

    return Allocations(out, campaign, {site.name: site for site in sites}, request, key_of)


def reopened(out: Path, sites: Path | None) -> Allocations | None:
    """The book of a run, to look at it and to end what is there; None: it has none.

    Raises:
        UsageError: it is damaged, or the sites file does not have its sites.
    """
    book = book_of(out)
    if book is None:
        return None
    file = load_sites(sites)
    if gone := [name for name in book.sites if name not in file.sites]:
        raise UsageError(f"{out}: has allocations at {', '.join(gone)}, no sites of the file")
    named = [NamedSite(n, file.sites[n].scheduler, file.sites[n]) for n in book.sites]
    nowhere = Conductor("", "", None)
    return opened(out, book.campaign, named, nowhere, CommonOptions())


def dismiss(out: Path) -> bool:
    """Tell the conductor of a run to end; False: none serves it.

    Raises:
        InfrastructureError: it does not hear.
    """
    if conductor.serving(out) is None:
        return False
    done = call(sys.executable, "-m", "conductor", "stop", "--state", str(out))
    if done.code:
        raise InfrastructureError(f"the conductor was not told to end: {done.last_words}")
    return True


def _by_hand(out: Path, site: NamedSite, served: Conductor, common: CommonOptions) -> str:
    """Write the key of a site that nobody reaches from here; what is to be typed there."""
    path = out / FOLDER_NAME / f"{site.name}.key"
    data = conductor.invitation(out, site.entry.connect or served.endpoint, served.namespace)
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        write_atomic(path, data, mode=0o600)
    except OSError as error:
        raise storage_error(error, str(path)) from None
    words = ["hpc", "scale", f"runs/{out.name}", "--key", path.name]
    words += ["--on", f"{site.scheduler}:{site.name}", "--target", "0:8"]
    if walltime := site.entry.time or common.time:
        words += ["--time", walltime]
    return f"{site.name}: copy {path} there, then type there: {shlex.join(words)}"
