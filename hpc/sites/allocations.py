"""Allocations of a run: written down before they are asked for, submitted once, looked after.

A book (:mod:`schemas.files.allocations`) in the run folder says what was asked for. An allocation
stands in it before anything is submitted, and its submission, asked for again after a kill, gives
the answer of the first time (:class:`hpc.commands.Place`), so there are never two jobs for one.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from hpc.backends import backend
from hpc.commands import UnknownOutcomeError, at, is_answered, refuse_submission, write_there
from hpc.request import JobRequest
from hpc.scheduler import JobStatus, RemoteScheduler, Scheduler, job_id
from hpc.sites.file import NamedSite
from hpc.sites.scaling import rest_s
from schemas.escape import escape
from schemas.files.allocations import (
    FILE_NAME,
    KEPT_MAX,
    Allocation,
    AllocationBook,
    JsonError,
    SiteRecord,
    read_book,
)
from schemas.kinds.batch_system import batch_systems
from twin.base.errors import (
    EXIT_PASS,
    EXIT_UNFINISHED,
    InfrastructureError,
    TwinError,
    UsageError,
    storage_error,
)
from twin.base.files import write_atomic

LOCK_NAME = "allocations.lock"
WHY_CHARS_MAX = 300
"""Longest reason that is written down [characters]."""
TERMINATED = 143
"""Exit code of a job that was told to end."""

RequestOf = Callable[[NamedSite, str, str], JobRequest]
"""Site, allocation and id of the run -> what is asked for."""


class Allocations:
    """The book of one run, and the sites that it names."""

    def __init__(
        self,
        folder: Path,
        campaign: str,
        sites: Mapping[str, NamedSite],
        request_of: RequestOf,
        key_of: Callable[[NamedSite], bytes],
    ) -> None:
        """Read the book of a run's allocations.

        Args:
            folder: run folder.
            campaign: what is run.
            sites: by name, also those of which nothing more is asked.
            request_of: makes a request.
            key_of: makes the key with which workers of a site join.

        Raises:
            UsageError: the book is damaged, or of another campaign.
        """
        self.folder = folder
        self.sites = sites
        self.request_of, self._key_of = request_of, key_of
        self.book = book_of(folder) or AllocationBook(campaign=campaign, run=secrets.token_hex(8))
        self._check()
        if self.book.campaign != campaign:
            raise UsageError(
                f"{folder}: has allocations for {escape(self.book.campaign, 200)}; choose another "
                "--out"
            )
        for name, site in sites.items():
            record = self.book.sites.setdefault(name, SiteRecord())
            record.cost = site.entry.cost

    def _check(self) -> None:
        """What runs as this user may write there, and job ids become words of commands."""
        for each in self.book.allocations:
            kind = batch_systems().get(each.scheduler)
            if kind is None or (each.job and not re.fullmatch(kind.job_ids, each.job)):
                what = f"{escape(each.scheduler, 80)} job {escape(each.job, 80)}"
                raise UsageError(
                    f"{self.folder / FILE_NAME}: {each.id}: {what} cannot be; choose another --out"
                )

    @property
    def open(self) -> list[Allocation]:
        """Allocations that have not ended, in the order in which they were made."""
        return [each for each in self.book.allocations if each.state != "ended"]

    @property
    def spent_h(self) -> float:
        """Worker-hours that they have had; open ones may still have all of theirs [h]."""
        return sum(
            each.workers
            * ((each.ended_s - each.made_s) / 3600 if each.state == "ended" else each.walltime_h)
            for each in self.book.allocations
        )

    @property
    def found_none_left(self) -> bool:
        """Whether workers of the newest allocation have left because no case was left."""
        ended = [each for each in self.book.allocations if each.state == "ended"]
        return bool(ended) and max(ended, key=lambda each: each.ended_s).code == EXIT_PASS

    def request(self, site: NamedSite, allocation: str) -> JobRequest:
        """What is asked of a site for one allocation.

        Raises:
            UsageError: a value cannot be used.
        """
        return self.request_of(site, allocation, self.book.run)

    def ask(self, site: NamedSite, why: str, now_s: float) -> Allocation:
        """Ask a site for one more.

        Raises:
            TwinError: it is refused, or the site is in trouble; the book says so.
        """
        if len(self.book.allocations) >= KEPT_MAX:
            raise UsageError(
                f"{self.folder}: {KEPT_MAX} allocations were asked for; choose another --out"
            )
        number = self.book.made + 1
        request = self.request(site, f"{site.name}-{number}")
        allocation = Allocation(
            id=request.allocation,
            site=site.name,
            scheduler=site.scheduler,
            workers=request.worker_count,
            walltime_h=request.walltime_min / 60,
            made_s=now_s,
            why=why,
        )
        self.book.made = number
        self.book.allocations.append(allocation)
        self.save()
        self.submit(allocation, now_s)
        return allocation

    def submit(self, allocation: Allocation, now_s: float) -> None:
        """Submit one that is written down; the same again if its answer was lost.

        Raises:
            TwinError: it is refused (the allocation has ended then), or nobody answers.
        """
        site = self._site_of(allocation)
        request = self.request(site, allocation.id)
        system = backend(site.scheduler)
        kind = batch_systems().find(site.scheduler)
        once = replace(site.place, once=request.out, submits=kind.submits)
        script = f"{request.out}/{kind.script}"
        try:
            text = system.render(request)
            with at(site.place):
                write_there(request.join, self._key_of(site), 0o600)
                write_there(script, text.encode(), 0o700)
                system.check(text, request)
            with at(once):
                said = system.submit(Path(script), Path(request.out))
            allocation.job = job_id(site.scheduler, said)
        except UnknownOutcomeError:
            # It may be there, and is looked for no more when its time is over in any case.
            if self._is_over(allocation, now_s):
                self._end(allocation, now_s, "nobody knows whether it was taken", failed=True)
            raise
        except InfrastructureError as error:
            if self._is_kept(site, request, kind.submits):
                if "timed out" in str(error).lower() and not self._is_over(allocation, now_s):
                    raise UnknownOutcomeError(
                        f"whether it was taken is not known: {error}"
                    ) from None
                # Asked again it would say the same for ever; the next one gets another number.
                self._end(allocation, now_s, str(error), failed=True)
                raise
            self._rest(allocation.site, now_s)
            allocation.why = escape(str(error), WHY_CHARS_MAX)
            raise
        except UsageError as error:
            self._end(allocation, now_s, str(error), failed=True)
            raise
        finally:
            if allocation.job:
                allocation.state = "queued"
            self.save()

    def refresh(self, joined: set[str], now_s: float) -> list[str]:
        """:meth:`look`, write down what was seen, and tidy up after what has ended; for whoever is
        :func:`alone`."""
        before = self.open
        lines = self.look(joined, now_s)
        self.save()
        for each in before:
            if each.state == "ended" and each.job:
                self._tidy(each)
        return lines

    def look(self, joined: set[str], now_s: float) -> list[str]:
        """Look at those that have not ended; lines about what has changed. Changes nothing at a
        site.

        ``joined``: ids of those of which the conductor sees a worker.
        """
        lines: list[str] = []
        for each in self.open:
            each.joined = each.joined or each.id in joined
            site = self.sites.get(each.site)
            if site is None or not each.job:
                continue
            before = each.state
            try:
                with at(site.place):
                    found = backend(site.scheduler).status(each.job)
            except TwinError as error:
                each.state = "unreachable"
                if before != each.state:
                    lines.append(f"{each.id}: {escape(str(error), WHY_CHARS_MAX)}")
                continue
            self._seen(each, found, now_s)
            if each.state != before:
                lines.append(f"{each.id}: {_change(each, found)}")
        return lines

    def end(self, allocation: Allocation, why: str, now_s: float) -> None:
        """Tell one to end; committed cases stay, running ones go back.

        Raises:
            TwinError: its site is in trouble, or nobody knows its job yet.
        """
        site = self._site_of(allocation)
        if not allocation.job:
            self._end_unsubmitted(site, allocation, why, now_s)
            return
        with at(site.place):
            backend(site.scheduler).cancel(allocation.job)
        allocation.dismissed, allocation.why = True, why
        if allocation.state == "queued":
            self._end(allocation, now_s, why, failed=False)
        self.save()

    def _end_unsubmitted(
        self, site: NamedSite, allocation: Allocation, why: str, now_s: float
    ) -> None:
        """End one that has no job, and see to it that it gets none."""
        submits = batch_systems().find(site.scheduler).submits
        folder = self.request(site, allocation.id).out
        if submits:
            with at(site.place):
                if refuse_submission(folder):
                    self._end(allocation, now_s, f"{why}, before it was submitted", failed=False)
                    self.save()
                    return
        raise InfrastructureError(
            f"its job is not known here, so it was not ended; `hpc scale` with --on "
            f"{site.scheduler}:{site.name} asks for it, or see {folder} there"
        )

    def _site_of(self, allocation: Allocation) -> NamedSite:
        site = self.sites.get(allocation.site)
        if site is None:
            raise UsageError(
                f"the sites file has no site {allocation.site} any more; put it back to look at "
                "its jobs and to end them"
            )
        return site

    def _is_kept(self, site: NamedSite, request: JobRequest, submits: str) -> bool:
        """Whether the site keeps the answer of a submission that has failed."""
        if not submits:
            return False
        try:
            with at(site.place):
                return is_answered(request.out)
        except TwinError:
            return False

    @staticmethod
    def _is_over(allocation: Allocation, now_s: float) -> bool:
        """Whether its time is over, had it been taken."""
        return now_s - allocation.made_s > 2 * 3600 * allocation.walltime_h

    def save(self) -> None:
        """Write the book.

        Raises:
            TwinError: it cannot be written.
        """
        try:
            write_atomic(self.folder / FILE_NAME, msgspec.json.encode(self.book))
        except OSError as error:
            raise storage_error(error, str(self.folder / FILE_NAME)) from None

    def _seen(self, each: Allocation, found: JobStatus, now_s: float) -> None:
        if found.state in ("pending", "running"):
            each.state = "queued" if found.state == "pending" else "running"
            return
        if found.state == "unknown":
            each.state = "unreachable"  # also for long: its workers may be there
            return
        each.code = code = found.exit_code
        failed = not each.dismissed and (
            not each.joined or code not in (None, EXIT_PASS, EXIT_UNFINISHED, TERMINATED)
        )
        why = each.why if each.dismissed else f"its workers left ({found.native or 'gone'})"
        if failed:
            how = found.native or "gone"
            how += f", exit code {code}" if code is not None else ""
            why = f"{'failed' if each.joined else 'ended without a worker that joined'} ({how})"
        self._end(each, now_s, why, failed=failed)

    def _tidy(self, each: Allocation) -> None:
        """Remove what a batch system keeps of a job that has ended, its key above all."""
        site = self._site_of(each)  # it was looked at there
        system: Scheduler = backend(site.scheduler)
        if isinstance(system, RemoteScheduler):
            with contextlib.suppress(TwinError), at(site.place):
                system.cancel(each.job)

    def _end(self, each: Allocation, now_s: float, why: str, *, failed: bool) -> None:
        each.state, each.ended_s, each.why = "ended", now_s, escape(why, WHY_CHARS_MAX)
        if failed:
            self._rest(each.site, now_s)
        elif each.joined:
            self.book.sites.setdefault(each.site, SiteRecord()).failures = 0

    def _rest(self, site: str, now_s: float) -> None:
        record = self.book.sites.setdefault(site, SiteRecord())
        record.failures += 1
        record.rests_until_s = now_s + rest_s(record.failures)


def _change(each: Allocation, found: JobStatus) -> str:
    """What has become of an allocation, in words."""
    if found.state == "unknown":
        said = f"says {found.native!r}" if found.native else "says nothing of it"
        return (
            f"how job {each.job} stands is not known ({each.scheduler} {said}); it is asked for "
            "again"
        )
    return f"{each.state}, {each.why}" if each.state == "ended" else each.state


def book_of(folder: Path) -> AllocationBook | None:
    """The book of a run folder; None: it has none.

    Raises:
        UsageError: it is damaged, or cannot be read.
    """
    try:
        return read_book(folder)
    except (JsonError, OSError) as error:
        raise UsageError(f"{folder / FILE_NAME}: {error}") from None


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Nobody else asks for allocations of this run while the block lasts.

    Raises:
        UsageError: somebody does already.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder / LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(
                f"{folder}: another `hpc submit` or `hpc scale` asks for allocations of this run "
                "now; end that one first"
            ) from None
        yield
    finally:
        os.close(descriptor)
