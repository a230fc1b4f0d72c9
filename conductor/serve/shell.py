"""The conductor process: bus, journal and files around the engine. One thread decides."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from conductor.core.facts import (
    CaseEnded,
    Committed,
    Fact,
    Generation,
    LateAttempt,
    Pinned,
    RecordingStored,
    Relocated,
    Replied,
    Retried,
    Snapshot,
    Submitted,
    is_durable,
)
from conductor.core.session import folder_for
from conductor.core.state import CampaignState, Config
from conductor.core.status import status
from conductor.journal.chain import Chain
from conductor.journal.store import FILE_NAME as JOURNAL_NAME
from conductor.journal.store import FolderLockedError, Journal, TakenOverError
from conductor.journal.timed_store import TimedStore
from conductor.records.timeline import append_events, mark_start
from conductor.run.case_lengths import history_line
from conductor.serve.audit import Audit
from conductor.serve.case_files import CaseFiles
from conductor.serve.companions import Companions
from conductor.serve.deliveries import Deliveries
from conductor.serve.engine import ConductorEngine, TurnResult
from conductor.serve.folders import Folders
from conductor.serve.inbox import Inbox, Item
from conductor.stored.link import StoreLink, StoreOptions
from conductor.stored.successor import lacking
from conductor.trust.judge_feed import JudgeFeed
from conductor.trust.manifest import RUN_FILE
from conductor.trust.sign_run import reopen
from schemas.sections.view_mode import ViewMode
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply, Request
from schemas.wire.delivery import Delivery
from schemas.wire.status import ConductorStatus
from twin.base.errors import InfrastructureError, TwinError, UsageError, storage_error
from twin.base.software import device_class, own_version, software_digest
from twin.fabric.address import check_free
from twin.fabric.bus import Bus, Respond
from twin.fabric.discovery import ConductorFile, find_conductor
from twin.fabric.endpoint import LOOPBACK, is_loopback, is_tls, to_listen
from twin.fabric.front.rules import Bucket
from twin.fabric.keys.authority import load_or_make
from twin.fabric.keys.key_file import MemberKey, WrongRoleError, shared
from twin.fabric.keys.own_keys import fabric_name
from twin.fabric.keys.roles import Role

if TYPE_CHECKING:
    from twin.fabric.front.router import Fronted

IDLE_S = 0.25
"""Longest sleep of the loop [s]."""
SUBMISSIONS_PER_MINUTE = 60
"""Most submissions of all keys together; each may be 16 MiB that is expanded into cases."""
FROZEN_MIN_S = 1.0
"""The loop was frozen when a turn of it took longer than this, and than ttl/4 [s]."""
LINGER_S = 5.0
"""After draining, how long workers are given to hear of it and say bye [s]."""
RECORDINGS_S = 10.0
"""A campaign whose recordings go into a store is signed so long after the latest result or
recording; one that comes later has it signed anew [s]."""

BusFactory = Callable[[Sequence[str], str, MemberKey | None], Bus]
"""(listen endpoints, namespace, key) -> open session."""

_log = logging.getLogger(__name__)


def open_router(listen: Sequence[str], namespace: str, key: MemberKey | None) -> Bus:
    """The conductor's session: a Zenoh router, so that workers need no other process."""
    from twin.fabric.zenoh_bus import open_bus

    return open_bus("router", listen=listen, namespace=namespace, key=key)


class Conductor:
    """Serves one state folder.

    Args:
        folder: state folder; created if missing.
        listen: endpoint; with port 0 the port of a predecessor that crashed is taken if free.
        namespace: prefix of every key.
        key: the conductor's; without one a TLS listener takes the folder's from the user's own
            folder, or makes it with those of the other roles.
        config: limits and options; its ``folder`` is replaced.
        bus_factory: opens the session; tests pass an in-memory one.
        store: result store beside the folder; None: there is none.
        history: folder of the earlier run that ``config`` has lengths of cases of; None: of none.
    """

    def __init__(
        self,
        folder: Path,
        *,
        listen: str = LOOPBACK,
        namespace: str = "twin",
        key: MemberKey | None = None,
        config: Config | None = None,
        bus_factory: BusFactory = open_router,
        store: StoreOptions | None = None,
        history: Path | None = None,
    ) -> None:
        self.folder, self.namespace = folder.absolute(), namespace
        self.endpoint = ""
        """Endpoint at which it listens, once started."""
        self.started, self.ended = threading.Event(), threading.Event()
        """``ended``: set when a campaign has no case left; who waits for it clears it."""
        self.key = key
        """The conductor's key, once started; None: plain TCP."""
        self.fabric = ""
        """Name under which its user's own folder has the keys; empty: those that were given."""
        self._listen = to_listen(listen, keyed=key is not None)
        self._config = replace(
            config or Config(),
            folder=str(self.folder),
            cpu=device_class("cpu"),
            store=store.url if store else "",
        )
        self.link: StoreLink | None = None
        """Its side of the result store, once started; None: there is none."""
        self._store_options = store
        self._history = history
        self._in_order = False
        """Whether the loop has come to a good end."""
        self._bus_factory = bus_factory
        self._audit = Audit(self.folder)
        self._inbox = Inbox(self._audit.refused)
        self._submissions = Bucket(SUBMISSIONS_PER_MINUTE / 60.0, burst_s=60.0)
        self._folders = Folders(self.folder)
        self._judge = JudgeFeed()
        self._lock = threading.Lock()
        self._stopping = False
        self._replaced = False
        """Whether another conductor serves the folder: its files are none of ours."""
        self._drained_ns: int | None = None
        self._software = ""
        """Digest, once it was needed."""
        self._journal: Journal | None = None
        self._bus: Bus | None = None
        self._fronted: Fronted | None = None
        self._engine: ConductorEngine | None = None
        self._deliveries: Deliveries | None = None
        self._case_files: CaseFiles | None = None

    def serve(self) -> None:
        """Start, serve until stopped or drained, shut down.

        Raises:
            TwinError: it cannot start, or its journal cannot be read or replicated any more.
        """
        try:
            self.startup()
            self.main_loop()
            assert self._engine is not None
            self._engine.close()
            self._in_order = True
        except TakenOverError:
            self._replaced = True
            raise
        finally:
            self.shutdown()

    def startup(self) -> None:
        """Lock the folder, fold the journal, raise the epoch on disk, and only then listen."""
        if self.key is not None and self.key.role is not Role.conductor:
            raise WrongRoleError(
                f"{self.key.path}: a key of role {self.key.role} may not serve, allowed: "
                f"{Role.conductor}; give --key of the folder of keys, or leave it away"
            )
        try:
            if not (self.folder / JOURNAL_NAME).exists():
                check_free(self._listen)  # or a folder, a journal and keys would stay behind
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise storage_error(error, str(self.folder)) from None
        predecessor = self._predecessor()
        self._open_engine(predecessor)
        assert self._engine is not None
        self._bus = self._open_bus(predecessor)
        self.endpoint = _reachable(self._bus.endpoints[0]) if self._bus.endpoints else "memory"
        if not is_tls(self._listen):
            _log.warning(
                "INSECURE: plain TCP at %s, because of --insecure: %s may read, submit, lease, "
                "commit, steer and stop, and so run commands as you",
                self.endpoint,
                "anybody on this host" if is_loopback(self._listen) else "whoever reaches it",
            )
        for topic in (topics.RPC_WORKER, topics.RPC_STATUS, topics.RPC_ADMIN, topics.RPC_SUBMIT):
            self._bus.serve(topic.key, partial(self._inbox.receive, route=topic.key))
        self._deliveries = Deliveries(self._folder_of)
        self._bus.serve(topics.FILES.key, self._deliveries.receive)
        self._case_files = CaseFiles(self._engine, self._lock)
        self._bus.serve(topics.CASE_FILES.key, self._case_files.receive)
        self._bus.watch(topics.WORKER_ALIVE.key.format(worker="*"), self._hint)
        self._folders.announce(
            ConductorFile(
                endpoint=self.endpoint,
                pid=os.getpid(),
                host=socket.gethostname(),
                epoch=self._engine.state.epoch,
                namespace=self.namespace,
                version=own_version() or "0",
                key=str(shared(self.key)) if self.key else "",
                insecure=not is_tls(self._listen),
                fabric=self.fabric,
            ),
            self._engine.state,
        )
        for campaign in self._engine.state.campaigns.values():
            if campaign.left:
                mark_start(Path(campaign.out), time.time())
        if self.link is not None:
            self.link.bring_back(self._engine.state, self._brought_back, self.campaign_folders)
        self.started.set()

    def _open_engine(self, predecessor: ConductorFile | None) -> None:
        """Journal and state, of the folder or taken over from the store."""
        if self._store_options is not None:
            self._take_key()
            self.link = StoreLink(self._store_options, self.folder, self.key)
            self.link.before_journal()
        try:
            self._journal = Journal(self.folder)
        except FolderLockedError as error:
            owner = f" (pid {predecessor.pid} on {predecessor.host})" if predecessor else ""
            raise UsageError(
                f"{error}{owner}; stop it with `conductor stop` or choose another folder"
            ) from None
        self._store = TimedStore(self._journal)
        self._engine = ConductorEngine(
            self._store,
            self._config,
            time.monotonic_ns(),
            self._check_folder,
            lambda: {"turned_away": self._inbox.turned_away, "journal_s": self._store.wall_s},
            self._audit,
            self._folders.lay_before,
            self.link.claim if self.link else lambda _: 0,
        )
        if self.link is not None:
            self._journal.mirror = self.link.begin(self._journal.rows)
            self._engine.take_found(self.link.found(self._engine.state), time.monotonic_ns())
        self._reopen()
        self._take_key()

    def _take_key(self) -> None:
        if self.key is None and is_tls(self._listen):
            self.key = load_or_make(self.folder)
            self.fabric = fabric_name(self.folder)

    def _brought_back(self, fact: Committed) -> None:
        """Files of a committed attempt have come from the store."""
        assert self._engine is not None
        with self._lock:
            self._judge.put(self._engine.state.campaigns[fact.result.campaign], fact)

    def campaign_folders(self) -> list[Path]:
        """Folders of its campaigns, once started; from any thread."""
        assert self._engine is not None
        with self._lock:
            return [Path(campaign.out) for campaign in self._engine.state.campaigns.values()]

    def main_loop(self) -> None:
        """Serve until :meth:`stop`, or until a drain has come to its end."""
        assert self._engine is not None
        frozen_ns = max(self._config.ttl_ns // 4, int(FROZEN_MIN_S * 1e9))
        before_ns = time.monotonic_ns()
        companions = Companions()
        while not self._stopping:
            if self.link is not None:
                self.link.check()
            group = self._inbox.group(self._patience_s(), companions)
            before_s = self._store.wall_s
            now_ns = time.monotonic_ns()
            with self._lock:
                if now_ns - before_ns > frozen_ns:
                    _log.warning("stood still for %.1f s", (now_ns - before_ns) / 1e9)
                    self._engine.woke(now_ns)
                before_ns = now_ns
                turn = self._turn(group)
                self._keep_files(turn.facts)
            self._answer(group, turn)
            with self._lock:
                self._bring_up_to_date(turn.facts)
            self._publish(turn.facts)
            commit_s = self._store.wall_s - before_s
            companions.committed(commit_s, len(group), self._inbox.waiting, time.monotonic())
            if self._drain_is_over():
                return

    def shutdown(self) -> None:
        """Write the outcomes, stop listening, release the folder; safe at any stage of startup."""
        self._stopping = True
        if self.link is not None:
            self.link.finish_bringing(stop=self._engine is None or bool(self._engine.state.left))
        if self._engine is not None and self.started.is_set() and not self._replaced:
            self._folders.close(self._engine.state)
            self._judge.close(self._engine.state.campaigns.values())
        if self._fronted is not None:
            self._fronted.close()
        if self._bus is not None:
            self._bus.close()
        self._audit.close()
        for server in (self._deliveries, self._case_files):
            if server is not None:
                server.close()
        if self.link is not None:
            self.link.close(released=self._in_order)
        if self._journal is not None:
            self._journal.close()

    def stop(self) -> None:
        """Ask the loop to end now; workers keep their leases and wait for a successor.

        May be called from any thread and from a signal handler.
        """
        self._stopping = True
        self._inbox.wake()

    def request(self, request: Request, timeout_s: float = 60.0) -> Reply:
        """Ask from inside the process, as a client on the bus would.

        Raises:
            InfrastructureError: no answer in time.
        """
        answers: queue.Queue[bytes] = queue.Queue()
        self._inbox.receive(encode(request), answers.put)
        try:
            return decode(answers.get(timeout=timeout_s), Reply)
        except queue.Empty:
            raise InfrastructureError(f"the conductor did not answer in {timeout_s:g} s") from None

    @property
    def alive(self) -> bool:
        """Whether it has started and has not begun to shut down; from any thread."""
        return self.started.is_set() and not self._stopping

    @property
    def worker_socket(self) -> int | None:
        """Descriptor of a nameless socket by which its own workers join; None: it has no front."""
        return self._fronted.socket_of(Role.worker) if self._fronted is not None else None

    def snapshot(self) -> ConductorStatus:
        """Status as of the last commit; from any thread."""
        with self._lock:
            if self._engine is None:
                return {}
            return status(self._engine.state, time.monotonic_ns()) | self._engine.health()

    def to_sign(self, *, last: bool = False) -> dict[Path, int]:
        """Folders of campaigns that came to their end and were judged, and are not signed yet, each
        with what :meth:`additions` says of what is on disk; ``last``: of all, whatever may still
        be added to them."""
        if self._engine is None or self._replaced or not self.started.is_set():
            return {}
        if self.link is not None and self.link.is_bringing:
            return {}
        with self._lock:
            ended = [c for c in self._engine.state.campaigns.values() if not c.left]
        unsigned = [c for c in ended if not (Path(c.out) / RUN_FILE).exists()]
        if not unsigned:
            return {}
        # Once, and only when it is asked for: every file of the software is read for it.
        self._software = self._software or software_digest()
        ours = ("", self._software)
        with self._lock:
            judged = [c for c in unsigned if c.software in ours and self._judge.is_done(c)]
            settled = [c for c in judged if not c.left and (last or self._is_settled(c))]
            return {Path(c.out): self._folders.additions(c)[0] for c in settled}

    def _is_settled(self, campaign: CampaignState) -> bool:
        """Whether all that has happened is on disk, and its recordings have had their time."""
        if self._folders.is_due(campaign):
            return False
        if not self._config.store or not ViewMode(campaign.campaign.view).records:
            return True
        _, latest_s = self._folders.additions(campaign)
        return time.monotonic() - latest_s >= RECORDINGS_S

    def additions(self, folder: Path) -> int:
        """Number of additions to the outcomes in ``folder`` since it serves; from any thread."""
        assert self._engine is not None
        with self._lock:
            for campaign in self._engine.state.campaigns.values():
                if Path(campaign.out) == folder:
                    return self._folders.additions(campaign)[0]
        return 0

    def chain(self) -> Chain:
        """Where its journal stands."""
        assert self._journal is not None
        return self._journal.chain

    # --- the loop, step by step -----------------------------------------------------------------

    def _patience_s(self) -> float:
        assert self._engine is not None
        until_s = (self._engine.next_expiry_ns() - time.monotonic_ns()) / 1e9
        return min(max(until_s, 0.001), IDLE_S)

    def _turn(self, group: list[Item]) -> TurnResult:
        assert self._engine is not None
        if group:
            return self._engine.turn([message for message, _ in group])
        return self._engine.tick(time.monotonic_ns())

    def _keep_files(self, facts: list[Fact]) -> None:
        """Do what has to be done before the replies leave."""
        assert self._engine is not None
        campaigns = self._engine.state.campaigns
        for fact in facts:
            match fact:
                case Submitted():
                    name = fact.campaign["campaign"]
                    self._folders.open_campaign(campaigns[name])
                    self._folders.record(campaigns[name])
                    self._say_known(campaigns[name])
                case Generation():
                    self._folders.grown(fact.campaign)
                case Relocated():
                    self._folders.relocated(campaigns[fact.campaign])
                case Pinned():
                    self._folders.open_campaign(campaigns[fact.campaign])
                case Retried():
                    self._unsign(Path(campaigns[fact.campaign].out))
                case LateAttempt():
                    self._unsign(Path(campaigns[fact.result.campaign].out))
                    self._folders.added(fact.result.campaign)
                case Committed():
                    self._judge.put(campaigns[fact.result.campaign], fact)
                    self._folders.added(fact.result.campaign)
                case CaseEnded():
                    self._folders.changed(fact.campaign)
                case RecordingStored():
                    self._unsign(Path(campaigns[fact.campaign].out))
                    self._folders.added(fact.campaign)
        self._folders.flush()

    def _bring_up_to_date(self, facts: list[Fact]) -> None:
        """Write what is for readers only: nobody's reply waits for all outcomes of a campaign."""
        assert self._engine is not None
        campaigns = self._engine.state.campaigns
        ended = {f.result.campaign for f in facts if isinstance(f, Committed)}
        ended |= {f.campaign for f in facts if isinstance(f, CaseEnded)}
        for name in ended:
            if not campaigns[name].left:
                self._folders.record(campaigns[name])
                self.ended.set()
        self._folders.flush()
        self._folders.refresh(self._engine.state)
        append_events(facts, campaigns, time.time())

    def _say_known(self, campaign: CampaignState) -> None:
        """Say how many cases of a new campaign the earlier run knows, if one was given."""
        names = (state.case.id for state in campaign.ordered)
        if line := history_line(self._history, self._config.lengths_s, names):
            _log.info("%s: %s", campaign.campaign.campaign, line)

    def _answer(self, group: list[Item], turn: TurnResult) -> None:
        for (_, respond), reply in zip(group, turn.replies, strict=False):
            if reply is None:
                continue
            if self.link is not None:
                self.link.when_kept(partial(_respond, respond, reply), len(reply))
            else:
                _respond(respond, reply)

    def _publish(self, facts: list[Fact]) -> None:
        assert self._bus is not None
        if not facts or not self._bus.wanted(topics.EVENT.key):
            return
        for fact in facts:
            if not is_durable(fact) or isinstance(fact, Replied | Snapshot):
                continue
            # The cases of a large campaign do not belong into an event.
            event: Fact = fact
            if isinstance(fact, Submitted):
                event = msgspec.structs.replace(fact, cases=[])
            elif isinstance(fact, Generation):
                event = msgspec.structs.replace(fact, cases=None, u=[], values=[])
            try:
                self._bus.publish(topics.EVENT.key, encode(event))
            except Exception:  # events are a courtesy
                _log.debug("an event could not be published", exc_info=True)

    def _drain_is_over(self) -> bool:
        """Whether nothing is leased any more, and every worker has left or has had time to."""
        assert self._engine is not None
        state = self._engine.state
        if not state.draining or state.leases:
            self._drained_ns = None
            return False
        now_ns = time.monotonic_ns()
        if self._drained_ns is None:
            self._drained_ns = now_ns
        present = any(
            now_ns - worker.seen_ns < self._config.ttl_ns for worker in state.workers.values()
        )
        return not present or now_ns - self._drained_ns > LINGER_S * 1e9

    # --- called on the bus's threads ------------------------------------------------------------

    def _hint(self, key: str, alive: bool) -> None:
        if not alive:
            self._inbox.hint(key.rpartition("/")[2])

    def _folder_of(self, message: Delivery) -> tuple[str, str]:
        """See :data:`conductor.serve.deliveries.FolderOf`."""
        assert self._engine is not None
        with self._lock:
            return folder_for(self._engine.state, message)

    # --- startup --------------------------------------------------------------------------------

    def _check_folder(self, request: Any) -> str:
        assert self._engine is not None
        if not self._submissions.has(1.0, time.monotonic()):
            return f"more than {SUBMISSIONS_PER_MINUTE} submissions in a minute; submit it later"
        return self._folders.check(self._engine.state, request)

    def _unsign(self, folder: Path) -> None:
        """Something was added to a campaign that may be signed: it is signed anew."""
        try:
            reopen(folder)
        except TwinError as error:
            _log.error("%s", error)

    def _reopen(self) -> None:
        """What was signed is none any more, and what no judge has seen is judged."""
        assert self._engine is not None
        was_signed = reopen(self.folder)
        for campaign in self._engine.state.campaigns.values():
            # Files that come from the store are judged when they have come.
            due = lacking([campaign]) if self.link is not None else []
            if campaign.left or due or not (was_signed or (Path(campaign.out) / RUN_FILE).exists()):
                self._judge.put_all(campaign, {fact.result.token for _, fact in due})

    def _predecessor(self) -> ConductorFile | None:
        try:
            return find_conductor(self.folder)
        except UsageError:
            return None

    def _open_bus(self, predecessor: ConductorFile | None) -> Bus:
        address, _, port = self._listen.rpartition(":")
        if port == "0" and predecessor is not None and predecessor.host == socket.gethostname():
            # Workers of the predecessor look for us there.
            with contextlib.suppress(TwinError):
                old_port = predecessor.endpoint.rpartition(":")[2]
                return self._open_at(f"{address}:{old_port}")
        return self._open_at(self._listen)

    def _open_at(self, endpoint: str) -> Bus:
        if self.key is None or not is_tls(endpoint) or self._bus_factory is not open_router:
            return self._bus_factory([endpoint], self.namespace, self.key)
        from twin.fabric.front.router import Fronted  # late: it imports Zenoh

        self._fronted = Fronted(endpoint, self.namespace, self.key, self._audit.heard)
        return self._fronted.bus


def _respond(respond: Respond, reply: bytes) -> None:
    try:
        respond(reply)
    except Exception:  # whoever asked is gone and will ask again
        _log.debug("a reply could not be sent", exc_info=True)


def _reachable(endpoint: str) -> str:
    """An address that other hosts can connect to, where it listens on all interfaces."""
    for everywhere in ("/0.0.0.0:", "/[::]:"):
        endpoint = endpoint.replace(everywhere, f"/{socket.gethostname()}:")
    return endpoint
