"""What the conductor keeps on disk beside its journal: small files, each written atomically.

Everything here can be rebuilt from the journal, so a write that fails is tried again later and
never stops the conductor.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import shutil
import time
from pathlib import Path

import msgspec
from msgspec import UNSET

from conductor.core.admit import out_mistake
from conductor.core.facts import Committed
from conductor.core.state import CampaignState, State
from conductor.records.attempts import LOG_FILE, leads_away
from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import encode_campaign
from conductor.records.search import encode_search
from schemas.campaign import Name
from schemas.escape import escape
from schemas.files.proposals import FILE_NAME as PROPOSED_FILE
from schemas.files.proposals import beside, encode_proposed
from schemas.files.regular_file import open_regular
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from schemas.files.yaml_file import dump_yaml
from schemas.wire.control import Submit
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.discovery import ConductorFile

CAMPAIGN_FILE = "campaign.yaml"
REFRESH_S = 5.0
"""Outcomes of a campaign that runs are written anew at most this often [s]."""
REFRESH_SHARE = 0.02
"""Share of the time that writing outcomes takes at most, however many cases there are."""

_log = logging.getLogger(__name__)


class Folders:
    """The files of one conductor: ``conductor.json``, ``campaign.yaml`` and ``outcomes.json``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._conductor_file: ConductorFile | None = None
        self._stale: dict[Path, bytes | bytearray] = {}
        """Files to be written, the latest content of each."""
        self._reported: set[Path] = set()
        self._yaml: dict[str, str] = {}
        """Campaign -> its file without the head; thousands of values take a while to write."""
        self._changed: set[str] = set()
        """Campaigns with news since their outcomes were written."""
        self._added: dict[str, tuple[int, float]] = {}
        """Campaign -> what :meth:`additions` says."""
        self._refresh_ns = 0
        """Time before which outcomes are not written again [ns]."""

    def check(self, state: State, request: Submit) -> str:
        """What is wrong with the folder of a submission, in one line, or nothing."""
        name = request.campaign.get("campaign")
        try:
            name = msgspec.convert(name, Name)
        except msgspec.ValidationError:
            return ""  # a mistake of the campaign, reported with the others
        if name in state.campaigns:
            return ""
        folder = Path(request.out) if request.out else self.folder / name
        if out_mistake(str(folder)):
            return ""  # reported by the core as well
        if any(campaign.out == str(folder) for campaign in state.campaigns.values()):
            return ""  # taken by a campaign of ours, reported by the core
        try:
            if (folder / CAMPAIGN_FILE).exists():
                return (
                    f"{name}: {folder} holds a campaign of another conductor; give another out "
                    "folder"
                )
            existing = next((p for p in (folder, *folder.parents) if p.exists()), Path("/"))
        except OSError as error:
            return escape(f"{name}: {folder}: {error.strerror}; give another out folder")
        if not existing.is_dir():
            return f"{name}: {existing} is not a folder; give another out folder"
        if not os.access(existing, os.W_OK):
            return f"{name}: {existing} cannot be written; give another out folder"
        return ""

    def lay_before(self, state: State) -> str:
        """Where the state folder lay before it was copied or moved here, for a journal that does
        not say; empty: here, as far as can be seen.

        Campaigns that came along have their files here, though the journal names another place.
        """
        for campaign in state.campaigns.values():
            out = Path(campaign.out)
            if out.is_relative_to(self.folder):
                return ""
            for came_along, before in ((self.folder, out), (self.folder / out.name, out.parent)):
                if _holds(came_along, campaign):
                    return str(before)
        return ""

    def announce(self, conductor_file: ConductorFile, state: State) -> None:
        """Tell where the conductor listens, in the state folder and every campaign folder.

        Raises:
            TwinError: the state folder cannot be written.
        """
        self._conductor_file = conductor_file
        path = self.folder / CONDUCTOR_FILE
        try:
            write_atomic(path, msgspec.json.encode(conductor_file) + b"\n")
        except OSError as error:
            raise storage_error(error, str(path)) from None
        for campaign in state.campaigns.values():
            self.open_campaign(campaign)
            if campaign.left:
                self.changed(campaign.campaign.campaign)
            else:
                self.record(campaign)
        self.flush()

    def open_campaign(self, campaign: CampaignState) -> None:
        """A campaign was submitted, or found in the journal, or pinned."""
        out = Path(campaign.out)
        self._describe(campaign)
        if self._conductor_file is not None:
            self._stale[out / CONDUCTOR_FILE] = msgspec.json.encode(self._conductor_file) + b"\n"

    def relocated(self, campaign: CampaignState) -> None:
        """Note that files of a campaign lie elsewhere now."""
        self._yaml.pop(campaign.campaign.campaign, None)
        self.open_campaign(campaign)

    def grown(self, campaign: str) -> None:
        """A search has proposed further cases, or ended; its files are due soon."""
        self._yaml.pop(campaign, None)
        self.changed(campaign)

    def record(self, campaign: CampaignState) -> None:
        """Write the outcomes as they stand; of a search, what it has proposed as well."""
        if campaign.search is not None:
            self._describe(campaign)
            self._stale[Path(campaign.out) / SEARCH_FILE] = encode_search(campaign)
        self._stale[Path(campaign.out) / OUTCOMES_FILE] = encode_campaign(campaign)
        self._changed.discard(campaign.campaign.campaign)

    def changed(self, campaign: str) -> None:
        """A case of ``campaign`` was leased, has ended or has a recording: its outcomes are due
        soon."""
        self._changed.add(campaign)

    def added(self, campaign: str) -> None:
        """Something came to the outcomes of ``campaign``."""
        count, _ = self._added.get(campaign, (0, 0.0))
        self._added[campaign] = count + 1, time.monotonic()
        self.changed(campaign)

    def additions(self, campaign: CampaignState) -> tuple[int, float]:
        """Number of additions to its outcomes since they are kept here, and when the latest came by
        the monotonic clock [s]; none: long ago."""
        return self._added.get(campaign.campaign.campaign, (0, -math.inf))

    def is_due(self, campaign: CampaignState) -> bool:
        """Whether the outcomes of ``campaign`` on disk lack something that has happened."""
        name = campaign.campaign.campaign
        return name in self._changed or Path(campaign.out) / OUTCOMES_FILE in self._stale

    def refresh(self, state: State) -> None:
        """Bring the outcomes of running campaigns up to date, if it is time: for reports."""
        began_ns = time.monotonic_ns()
        if not self._changed or began_ns < self._refresh_ns:
            return
        for name in list(self._changed):
            self.record(state.campaigns[name])
        self.flush()
        ended_ns = time.monotonic_ns()
        pause_ns = max(REFRESH_S * 1e9, (ended_ns - began_ns) / REFRESH_SHARE)
        self._refresh_ns = ended_ns + int(pause_ns)

    def sweep(self, campaign: CampaignState) -> None:
        """Clear attempt folders of committed cases that no fact names, which ended rigs left: what
        the stack printed stays.

        Cases without a committed result keep everything, for whoever looks into them.
        """
        for name, case in campaign.cases.items():
            if case.attempts < 2 or not isinstance(end := case.end, Committed):
                continue
            named = {end.result.attempt_dir, *(late.result.attempt_dir for late in case.late)}
            named |= {f"cases/{name}/attempt-{steered.attempt}" for steered in case.steered}
            folder = Path(campaign.out) / "cases" / name
            if leads_away(Path(campaign.out), folder):
                continue  # somebody has put a link there: what is behind it is none of ours
            for attempt in folder.glob("attempt-*"):
                if f"cases/{name}/{attempt.name}" not in named:
                    _clear(attempt)

    def flush(self) -> None:
        """Write what is to be written; what fails stays for the next call."""
        for path, data in list(self._stale.items()):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, data)
            except OSError as error:
                if path not in self._reported:
                    _log.error("%s; it will be tried again", storage_error(error, str(path)))
                self._reported.add(path)
                continue
            self._reported.discard(path)
            del self._stale[path]

    def close(self, state: State) -> None:
        """A clean shutdown: outcomes are written, and nobody is told to connect any more."""
        for campaign in state.campaigns.values():
            if campaign.attempts:
                self.record(campaign)
            if not campaign.left:
                self.sweep(campaign)
        self.flush()
        for folder in (*(Path(c.out) for c in state.campaigns.values()), self.folder):
            try:
                (folder / CONDUCTOR_FILE).unlink(missing_ok=True)
            except OSError as error:
                _log.error("%s", storage_error(error, str(folder / CONDUCTOR_FILE)))

    def _describe(self, campaign: CampaignState) -> None:
        """The effective campaign; what its search has proposed lies beside it, written first."""
        out, name, search = Path(campaign.out), campaign.campaign.campaign, campaign.campaign.search
        if name not in self._yaml:
            content = msgspec.to_builtins(campaign.campaign)
            if campaign.search is not None and search is not UNSET:
                data = encode_proposed(search.proposed)
                self._stale[out / PROPOSED_FILE] = data
                content = beside(content, data)
            self._yaml[name] = dump_yaml(content)
        self._stale[out / CAMPAIGN_FILE] = self._campaign_yaml(campaign)

    def _campaign_yaml(self, campaign: CampaignState) -> bytes:
        """The campaign file; digests stand in comments, so that it can be submitted."""
        name = campaign.campaign.campaign
        lines = [_head_line(campaign)]
        if campaign.pinned:
            lines.append(f"# software digest: {campaign.software}")
            lines.append(f"# device class: {campaign.device_class or 'any'}")
        return ("\n".join(lines) + "\n" + self._yaml[name]).encode()


def _head_line(campaign: CampaignState) -> str:
    return f"# campaign digest: {campaign.digest}"


def _holds(folder: Path, campaign: CampaignState) -> bool:
    """Whether this is the folder of ``campaign``, or a copy of it."""
    head = _head_line(campaign).encode()
    try:
        with open_regular(folder / CAMPAIGN_FILE) as file:
            return file.readline(len(head) + 1).rstrip() == head
    except OSError:
        return False


def _clear(attempt: Path) -> None:
    """Remove all of an attempt folder but its log."""
    if attempt.is_symlink() or not (attempt / LOG_FILE).is_file():
        shutil.rmtree(attempt, ignore_errors=True)
        return
    with contextlib.suppress(OSError):
        for entry in attempt.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != LOG_FILE:
                entry.unlink(missing_ok=True)
