"""What only a console of running cases answers: events, workers, and acts by role."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from schemas import SCHEMA_VERSION
from schemas.escape import escape
from schemas.wire.case_files import CaseFilePiece, CaseFileRequest
from schemas.wire.control import Control
from schemas.words import counted
from twin.base.errors import TwinError, UnreachableError, UsageError
from twin.fabric.discovery import Target
from viewer.console.acts import ACTS, ActName, ActRequest, panel_body, parse_act, warning_of
from viewer.console.overview import table_version
from viewer.console.remote_files import RemoteFiles
from viewer.console.resources import resources_of
from viewer.console.site import ConsoleSite
from viewer.console.stream import EventStream
from viewer.console.watch import SILENCE_S, LiveWatch

EXPLAINED_MAX = 16
"""Cases that are explained at once; each is a question to the conductor."""
EXPLAINED_S = 5.0
"""How long an explanation stands before it is asked for again [s]."""


class Operator(Protocol):
    """Way to a conductor and its running cases: :class:`viewer.browser.desk.Desk`."""

    def operates(self) -> bool:
        """Whether it may change anything."""

    def control(self, request: Control) -> int:
        """Have the conductor do something; what changed."""

    def explain(self, campaign: str, case: str) -> list[str]:
        """Why a case waits, runs or has ended."""

    def do(self, body: bytes) -> bytes:
        """Intervene in a running case."""

    def case_file(self, request: CaseFileRequest) -> CaseFilePiece | None:
        """A piece of a file of a committed attempt; None: no answer."""


class LiveConsole:
    """Stands between the pages and one conductor."""

    def __init__(
        self,
        site: ConsoleSite,
        resolve: Callable[[], Target],
        operator: Operator,
        *,
        here: bool,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """As :class:`LiveWatch`; ``operator``: way to change something."""
        self.stream = EventStream(secrets.token_hex(6))
        files = RemoteFiles(self._case_file)
        self.watch = LiveWatch(site, resolve, self.stream, here=here, say=say, files=files)
        self._site, self._operator = site, operator
        self._explained: dict[tuple[str, str], tuple[float, list[str]]] = {}
        self._lock = threading.Lock()

    def start(self) -> None:
        """Begin to listen."""
        self.watch.start()

    def close(self) -> None:
        """Let pages go and end the session."""
        self.watch.close()

    def role(self, trusted: bool) -> str:
        """What a page may do; ``trusted``: it knows the token of the printed address."""
        if not trusted:
            return "look"
        try:
            return "operate" if self._operator.operates() else "look"
        except TwinError:
            return "look"

    @property
    def waits(self) -> bool:
        """Whether the conductor has said nothing yet: what is missing now may come."""
        return self.watch.status_s is None and self.watch.error is None

    def hello(self, resync: bool) -> dict[str, Any]:
        """First event of a page: what it must ask for anew, if anything."""
        return {
            "server": self.stream.epoch,
            "resync": resync,
            "version": {name: table_version(run) for name, run in self._site.runs.items()},
            "conductor_age_s": self.watch.age_s,
            "log": self.watch.lines,
        }

    def workers(self, run: str) -> dict[str, Any]:
        """Workers, leases, and what is quarantined and why, for one campaign."""
        watch, status = self.watch, self.watch.status
        campaign = watch.campaign_of(run)
        leases = [row for row in status.get("running", []) if row["campaign"] == campaign]
        return {
            "age_s": watch.age_s,
            "draining": status.get("draining", False),
            "storage_error": status.get("storage_error", "") or None,
            "workers": status.get("workers", []),
            "leases": leases,
            "notes": [escape(line) for line in status.get("notes", [])],
            "hosts": [escape(line) for line in status.get("broken_hosts", [])],
            "quarantine": self._quarantine(run, campaign) if campaign else [],
            "resources": resources_of(self._site.run(run)),
        }

    def act(self, name: str, body: bytes) -> dict[str, Any]:
        """Say what an act would do or, confirmed, do it.

        Raises:
            TwinError: it is refused; one line.
        """
        act = next((act for act in ACTS if act == name), None)
        if act is None:
            raise UsageError(f"act: given '{name}', allowed: {', '.join(ACTS)}")
        request = parse_act(body)
        campaign = self._campaign(act, request)
        if act == "intervene" and request.campaign != campaign:
            raise UsageError(
                f"intervene: '{request.run}' is {campaign}, the attempt is of "
                f"'{request.campaign}'; reload the page"
            )
        row = self.watch.status.get("campaigns", {}).get(campaign)
        warning = warning_of(act, request, campaign, row["left"] if row else None)
        if not request.confirm:
            return {"confirm": warning}
        if act == "intervene":
            self._operator.do(panel_body(request))
            return {"done": f"{request.case}: done"}
        changed = self._operator.control(
            Control(
                v=SCHEMA_VERSION,
                action=act,
                campaign="" if act == "drain" else campaign,
                case="" if act == "drain" else request.case,
                worker=request.worker if act == "drain" else "",
            )
        )
        what = "worker" if act == "drain" else "case"
        return {"done": f"{act} {request.worker or campaign}: {counted(changed, what)}"}

    def _case_file(self, request: CaseFileRequest) -> CaseFilePiece | None:
        age_s = self.watch.age_s
        if age_s is None or age_s > SILENCE_S:
            raise UnreachableError("the conductor is silent")  # each question would wait in vain
        return self._operator.case_file(request)

    def _campaign(self, act: ActName, request: ActRequest) -> str:
        if act == "drain":
            return ""
        campaign = self.watch.campaign_of(request.run)
        if campaign is None:
            raise UsageError(f"{act}: '{request.run}' is no campaign that this conductor serves")
        return campaign

    def _quarantine(self, run: str, campaign: str) -> list[dict[str, Any]]:
        charged = dict(self.watch.charged.get(run, {}))
        try:
            endings = self._site.runs[run].endings()
        except (TwinError, OSError):
            endings = {}  # the list says what is wrong with the run; its workers go on
        for case, ending in endings.items():
            if len(charged) >= EXPLAINED_MAX:
                break
            if ending.charges and not ending.outcome:
                charged.setdefault(case, escape(ending.charges[-1]))
        age_s = self.watch.age_s
        answers = age_s is not None and age_s <= SILENCE_S  # else each question waits in vain
        return [
            {
                "case": case,
                "charge": why,
                "explain": self._explain(campaign, case) if answers else [],
            }
            for case, why in list(charged.items())[:EXPLAINED_MAX]
        ]

    def _explain(self, campaign: str, case: str) -> list[str]:
        now_s = time.monotonic()
        with self._lock:
            stood = self._explained.get((campaign, case))
        if stood is not None and now_s - stood[0] < EXPLAINED_S:
            return stood[1]
        try:
            lines = [escape(line) for line in self._operator.explain(campaign, case)]
        except TwinError as error:
            lines = [escape(str(error))]
        with self._lock:
            if len(self._explained) > 4 * EXPLAINED_MAX:
                self._explained.clear()
            self._explained[campaign, case] = now_s, lines
        return lines
