"""The judge of a conductor: one process that is told every attempt that was committed.

It comes to verdict and scalars again from the attempt's files (``twin judge``). What it finds is
kept beside the outcomes, ``judgement.json``: reports refuse a campaign with a difference.
"""

from __future__ import annotations

import logging
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from msgspec import Struct

from conductor.core.facts import Committed
from conductor.core.state import CampaignState
from schemas.files.json_text import JsonError, decode_json
from schemas.files.judging import CLAIMED, Claim, Judgement
from twin.base.errors import InfrastructureError, storage_error
from twin.base.files import write_atomic
from twin.base.process import PARENT_VARIABLE, end, how_it_ended, spawn

FILE_NAME = "judgement.json"
TRIES = 2
"""A judge that dies with an attempt is started again for it, so often at most."""
TOLD_MAX = 20
"""Cases whose differences are logged; all are in ``judgement.json``."""
KEPT = ("PATH", "LANG", "LC_ALL", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH")
"""Variables of the environment that a judge gets; secrets of others are none of its business."""

_log = logging.getLogger(__name__)


class JudgementFile(Struct, frozen=True, kw_only=True):
    """Content of ``judgement.json``."""

    schema: int = 1
    attempts: int
    """Committed attempts with KPI rows that were judged."""
    agree: int
    differences: dict[str, list[str]]
    """Case -> in what its verdict does not follow from its files, one line each."""


class Judge:
    """A judge's process, started when it is needed; of one thread."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None

    def ask(self, claim: Claim) -> Judgement:
        """Judgement about one attempt; that it cannot be judged is a difference, too."""
        died = ""
        for _ in range(TRIES):
            try:
                if self._child is None:
                    self._child = _start()
                return _answer(self._child, claim)
            except (OSError, EOFError, msgspec.MsgspecError):
                if self._child is not None:
                    end(self._child)
                    died = how_it_ended(self._child.returncode)
                    self._child = None
        line = f"not judged: the judge ended ({died or 'it could not be started'})"
        return Judgement(folder=claim.folder, case=claim.case, found="differs", differences=[line])

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            end(self._child)
            self._child = None


def _answer(child: subprocess.Popen[bytes], claim: Claim) -> Judgement:
    assert child.stdin is not None
    assert child.stdout is not None
    data = memoryview(msgspec.json.encode(claim) + b"\n")
    while data:
        data = data[child.stdin.write(data) or 0 :]
    line = child.stdout.readline()
    if not line:
        raise EOFError
    judgement = msgspec.json.decode(line, type=Judgement)
    if judgement.found == "no record":  # the simulator of today writes one
        return msgspec.structs.replace(
            judgement, found="differs", differences=["there is no judge.json beside its KPI rows"]
        )
    return judgement


@dataclass(slots=True)
class _Tally:
    """Tally of one campaign."""

    asked: int = 0
    attempts: int = 0
    """Number of attempts that are judged."""
    differences: dict[str, list[str]] = field(default_factory=dict)


class JudgeFeed:
    """Hands committed attempts to the judge, in order, on a thread of its own."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Claim | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._judge = Judge()
        self._judged: dict[str, _Tally] = {}
        """Tallies by campaign folder."""
        self._over = False

    def put(self, campaign: CampaignState, fact: Committed) -> None:
        """An attempt was committed; never waits."""
        result = fact.result
        if not result.kpi_sha256 or campaign.campaign.simulator == "noop":
            return
        self._judged.setdefault(campaign.out, _Tally()).asked += 1
        self._waiting.put(
            Claim(
                folder=campaign.out,
                case=result.case,
                scenario=campaign.cases[result.case].case.variation.scenario,
                **{name: getattr(result, name) for name in CLAIMED},
            )
        )
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="judge", daemon=True)
            self._thread.start()

    def put_all(self, campaign: CampaignState, lacking: Set[int] = frozenset()) -> None:
        """Hand over what an earlier conductor has committed, but for the tokens of attempts whose
        files are ``lacking`` yet."""
        for case in campaign.ordered:
            end = case.end if case.ended else None
            if isinstance(end, Committed) and end.result.token not in lacking:
                self.put(campaign, end)

    def close(self, campaigns: Iterable[CampaignState]) -> None:
        """End the judge; of campaigns that are complete, when all is judged and written down."""
        complete = [campaign for campaign in campaigns if not campaign.left]
        self._over = not complete
        self._waiting.put(None)
        if self._thread is not None:
            self._thread.join()
        for campaign in complete:
            self._write(campaign)

    def _run(self) -> None:
        while (claim := self._waiting.get()) is not None and not self._over:
            judged = self._judge.ask(claim)
            tally = self._judged[claim.folder]
            tally.attempts += 1
            if judged.differences:
                tally.differences[claim.case] = judged.differences
            if len(tally.differences) <= TOLD_MAX:
                for line in judged.differences:
                    _log.error("case %s: %s", claim.case, line)
        self._judge.close()

    def is_done(self, campaign: CampaignState) -> bool:
        """Whether all that was committed of it so far is judged; then it is written down."""
        tally = self._judged.get(campaign.out)
        if tally is not None and tally.attempts < tally.asked:
            return False
        self._write(campaign)
        return True

    def _write(self, campaign: CampaignState) -> None:
        tally = self._judged.get(campaign.out)
        if not tally:
            return
        judged = JudgementFile(
            attempts=tally.attempts,
            agree=tally.attempts - len(tally.differences),
            differences=tally.differences,
        )
        path = Path(campaign.out) / FILE_NAME
        try:
            write_atomic(path, msgspec.json.format(msgspec.json.encode(judged), indent=1) + b"\n")
        except OSError as error:
            _log.error("%s", storage_error(error, str(path)))


def read_judged(folder: Path) -> JudgementFile | None:
    """What the judge has found about a run; None: nothing was judged.

    Raises:
        InfrastructureError: the file is damaged.
    """
    path = folder / FILE_NAME
    try:
        return decode_json(path.read_bytes(), JudgementFile)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InfrastructureError(f"{path}: {error.strerror or error}") from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}") from None


def _start() -> subprocess.Popen[bytes]:
    kept = [f"{name}={os.environ[name]}" for name in KEPT if name in os.environ]
    parent = f"{PARENT_VARIABLE}={os.getpid()}"
    judge = [sys.executable, "-m", "twin", "judge", "--claims"]
    return spawn(["/usr/bin/env", "-i", *kept, parent, *judge], pipe_output=True)
