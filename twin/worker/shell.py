"""The worker process: control session, rig processes and signals around the pure core."""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import structs

from schemas import SCHEMA_VERSION
from schemas.kinds.bridge import lacking_bridges
from schemas.kinds.perception import lacking_perceptions
from schemas.kinds.plugins import lacking_plugins
from schemas.kinds.registry import installed_plugins
from schemas.sections.view_mode import RECORDER
from schemas.wire import topics
from schemas.wire.codec import WireError, decode, encode
from schemas.wire.control import Beat, Bye, Hello, Lease, Next, Reply, Request, Result
from schemas.wire.rpc_routes import route_key
from schemas.wire.site_name import host_at
from twin.base.errors import (
    EXIT_PASS,
    EXIT_UNFINISHED,
    InfrastructureError,
    TwinError,
    UnfinishedError,
    UnreachableError,
    UsageError,
    storage_error,
)
from twin.base.process import end
from twin.base.software import device_class, software_digest
from twin.fabric.bus import Bus
from twin.fabric.endpoint import check_protected, to_listen
from twin.fabric.port_turn import await_turn, turn_at
from twin.fabric.session import new_secret, seal
from twin.fabric.zenoh_bus import open_bus
from twin.rig.attempt_log import failure, write_failure, write_log
from twin.rig.pipe import (
    Broken,
    Building,
    Built,
    CaseDone,
    Faulted,
    Intervened,
    IntervenedDone,
    Listening,
    Progress,
    RefusedPeer,
)
from twin.stores.protocol import StoreError
from twin.stores.putting import Storing, meanwhile
from twin.stores.recordings import RecordingUploads
from twin.worker.announcement import sweep
from twin.worker.core import SECOND_NS, Core
from twin.worker.delivery import Delivery
from twin.worker.effects import (
    AbandonToken,
    Ask,
    AssignLease,
    Effect,
    FailCase,
    FailUnbegun,
    KeepLogs,
    Leave,
    Say,
    SpoolForget,
    SpoolWrite,
    StartRig,
    StopRig,
)
from twin.worker.held import Silence
from twin.worker.options import WorkerOptions, fitting, lacking_recorder
from twin.worker.protection import lacking_sandbox
from twin.worker.resources_log import ResourceLog, work_of
from twin.worker.rig_process import RecorderEnded, RigDied, RigProcess, StackLeft, port_of
from twin.worker.spool_folder import SpoolFolder
from twin.worker.stack_process import Loading, compile_kernels

REQUEST_TIMEOUT_S = 3.0
"""Longest wait for the conductor's answer before the request is repeated [s]."""

HAND_BACK_S = 15.0
"""Everything is given back so long before the walltime: rigs end, the conductor hears it [s]."""

MEMORY_PERIOD_NS = 1_000_000_000
"""How often the memory of the rig is looked at, if it has a limit [ns]."""

BEAT_S = 2.0
"""While results are delivered, the conductor hears of us this often [s]."""

TURN_S = 0.05
"""Longest wait of the main loop, so that clocks and children are looked at [s]."""


@dataclass(frozen=True, slots=True)
class _Answered:
    request: Request
    reply: Reply | None


@dataclass(frozen=True, slots=True)
class _Undeliverable:
    error: str


@dataclass(frozen=True, slots=True)
class _Mistaken:
    """The thread that speaks with the conductor has ended by a mistake of the program."""

    error: str


@dataclass(frozen=True, slots=True)
class _Heard:
    """The conductor has answered a heartbeat while a request waits for something else."""


@dataclass(frozen=True, slots=True)
class _PortFree:
    """The turn of another rig of this host has ended."""


@dataclass(frozen=True, slots=True)
class _Signalled:
    name: str


@dataclass(frozen=True, slots=True)
class Abilities:
    """What a worker finds out about this installation and this host before it joins."""

    software: str
    """Software digest."""
    lacks: dict[str, str]
    plugins: dict[str, str]
    """Both as in :class:`schemas.wire.control.Hello`."""

    @classmethod
    def here(cls) -> Abilities:
        """Look; files are read for a tenth of a second."""
        lacks = lacking_bridges() | lacking_sandbox() | lacking_plugins() | lacking_perceptions()
        return cls(software_digest(), lacks, installed_plugins())


class Worker:
    """serve = startup, main loop, shutdown."""

    def __init__(
        self,
        options: WorkerOptions,
        loading: Loading | None = None,
        abilities: Abilities | None = None,
    ) -> None:
        """Make a worker that has not started yet.

        Args:
            options: how, and for whom.
            loading: processes that wait for the first rig.
            abilities: what was found out already; None: it looks now.
        """
        abilities = abilities or Abilities.here()
        self._options = options
        self._loading = loading
        self._inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._requests: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        self.rig: RigProcess | None = None
        """Processes of the rig; None: there is none."""
        self._bus: Bus | None = None
        self._spool = SpoolFolder(options.spool)
        self._delivery: Delivery | None = None
        self._storing = Storing(seal)
        self._store_words = ""
        """Why the store does not take results just now; empty: it does."""
        self._compiling: subprocess.Popen[bytes] | None = None
        self._asked_s = 0.0
        self._error = self._silent = self._mistake = ""
        self._left = False
        self._memory_at_ns = 0
        host = host_at(socket.gethostname(), options.site)
        memory_bytes = None if options.memory_gb is None else int(options.memory_gb * 1e9)
        self.id = f"{host}-{options.device.replace(':', '')}-{secrets.token_hex(6)}"
        # In the memory of this process alone: no child inherits it, and nothing of it is written.
        session = new_secret()
        self.recordings = RecordingUploads(self.id, session, options.view, self._request, _log)
        self._resources = ResourceLog(self.id, host, options.device, _log)
        self.core = Core(
            Hello(
                v=SCHEMA_VERSION,
                worker=self.id,
                host=host,
                pid=os.getpid(),
                device_class=device_class(options.device),
                software=abilities.software,
                slots=options.slots,
                walltime_end_s=None
                if options.walltime_s is None
                else time.time() + options.walltime_s,
                memory_bytes=memory_bytes,
                tags=list(options.tags),
                share=options.share,
                lacks=abilities.lacks | lacking_recorder(options.view),
                plugins=abilities.plugins,
                session=session,
            ),
            until_done=options.until_done,
            drain_ns=int(options.drain_s * SECOND_NS),
            walltime_end_ns=_walltime_end_ns(options.walltime_s),
            memory_max_bytes=memory_bytes,
            fitting=partial(fitting, options.device, options.slots) if options.fit else None,
            silence=Silence(None if options.away_s is None else int(options.away_s * SECOND_NS)),
        )

    def serve(self) -> int:
        """Run until told to leave; the exit code."""
        self._startup()
        try:
            while not self._left:
                self._turn()
        finally:
            self._shutdown()
        if self._mistake:
            raise InfrastructureError(
                f"requests to the conductor ended by a mistake of this program: {self._mistake}; "
                "its cases run elsewhere, please report what stands above"
            )
        if self._error:
            raise UsageError(f"conductor refuses this worker: {self._error}")
        if self._silent and self._options.started_again:
            raise UnfinishedError(f"{self._silent}; whoever started this may start it again")
        if self._silent:
            raise UnreachableError(f"{self._silent}; check that the conductor runs")
        unfinished = self._options.started_again and self.core.cases_left
        return EXIT_UNFINISHED if unfinished else EXIT_PASS

    def _startup(self) -> None:
        # Rigs make their own keys, so that no stack's frames leave this host as plain TCP.
        check_protected(to_listen(self._options.drive_listen, keyed=True), keyed=True)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1):
            signal.signal(number, self._on_signal)
        self._bus = open_bus(
            "client",
            connect=[self._options.handed or self._options.connect],
            namespace=self._options.namespace,
            key=self._options.key,
        )
        self._delivery = Delivery(self._bus, self.id, self.core.hello.session)
        if self._options.join_dir and (gone := sweep(Path(self._options.join_dir))):
            _log(f"{self._options.join_dir}: removed what {len(gone)} dead rigs left")
        self._bus.announce(topics.WORKER_ALIVE.key.format(worker=self.id))
        threading.Thread(target=self._rpc_loop, name="rpc", daemon=True).start()
        self._carry_out(self.core.on_spool(self._spool.read()))
        self._resources.start()
        self._compiling = compile_kernels(self._options.device)
        _log(f"worker {self.id}: {self._options.slots} slot(s) on {self._options.device}")
        if lack := self.core.hello.lacks.get(RECORDER):
            _log(f"writes no recordings, {lack}")
        for name, lack in lacking_perceptions().items():
            _log(f"cannot run the {name}, {lack}")

    def _shutdown(self) -> None:
        self._resources.close()
        if self._compiling is not None:
            self._compiling.kill()
            end(self._compiling)
        if self.rig is not None:
            self.rig.stop()
        if self._loading is not None:
            self._loading.discard()
        self._requests.put(None)
        self.recordings.finish(0.0)  # without a goodbye nobody has said what is lost
        if self._bus is not None:
            self._bus.close()
        if self._delivery is not None:
            self._delivery.close()

    def _on_signal(self, number: int, _frame: object) -> None:
        self._inbox.put(_Signalled(signal.Signals(number).name))

    def _rpc_loop(self) -> None:
        """Requests one after the other; the main loop never waits for the conductor."""
        while (request := self._requests.get()) is not None:
            try:
                if isinstance(request, Bye):  # afterwards nobody believes us
                    self.recordings.finish()
                reply = self._next(request) if isinstance(request, Next) else self._ask(request)
                if reply is not None and isinstance(request, Hello):
                    self._storing.join(reply.store)
                    self.recordings.join(self._storing.store)
            except (TwinError, OSError) as error:
                self._inbox.put(_Undeliverable(str(error)))
                return
            except Exception as error:  # a mistake of ours, or a library's: nobody asks any more
                traceback.print_exc()
                self._inbox.put(_Mistaken(repr(error)))
                return
            self._inbox.put(_Answered(request, reply))

    def _next(self, request: Next) -> Reply | None:
        """Files of results that the conductor cannot see go before their commit."""
        assert self._delivery is not None
        over = [end.token for end in (*request.results, *request.ended)]
        tokens = [*request.held, *over]
        # Files may take a while; the heartbeats that are due meanwhile are sent from here.
        beat = Beat(
            v=SCHEMA_VERSION,
            worker=request.worker,
            held=dict.fromkeys(map(str, tokens), 0),
            session=request.session,
        )
        if not self._delivery.deliver(
            request.results, request.ended, lambda: self._beat_if_due(beat)
        ):
            self._beat_if_due(beat)
            return None
        kept = self._put(request, beat)
        if kept is None:
            return None
        if self._delivery.fenced:
            # No result may be committed without its files: it must be fenced as well.
            heard = self._ask(beat)
            if heard is None or heard.error or not self._delivery.fenced <= {*heard.lost}:
                self._delivery.fenced.clear()
                return heard if heard is not None and heard.error else None
        reply = self._ask(kept)
        if reply is not None and not reply.error:
            self._storing.forget(over)
            self._delivery.forget(self.recordings.settle(over, request.results, reply.fenced))
            for line in self._delivery.look(reply.leases, stored=self._storing.store is not None):
                _log(line)
            for lease in map(self._delivery.localized, reply.leases):
                self._storing.look(lease)
                self.recordings.look(lease)
        return reply

    def _put(self, request: Next, beat: Beat) -> Next | None:
        """The request, when all that it commits is in the store; None: it has to wait."""
        line, kept = "", request
        try:
            if self._storing.store is not None:  # a thread for each request that may have to wait
                kept = meanwhile(
                    lambda: self._stored(request), lambda: self._beat_if_due(beat), BEAT_S / 4
                )
        except StoreError as error:
            line = f"{error}; cases go on, results wait"
            self._beat_if_due(beat)
        if line != self._store_words:
            self._store_words = line
            _log(line or "the store answers again")
        return None if line else kept

    def _stored(self, request: Next) -> Next:
        self._storing.put(request, lambda: None)
        return structs.replace(request, sealed=self._storing.with_files(request.sealed))

    def _beat_if_due(self, beat: Beat) -> None:
        if time.monotonic() - self._asked_s > BEAT_S and self._ask(beat) is not None:
            self._inbox.put(_Heard())

    def _ask(self, request: Request) -> Reply | None:
        reply = self._request(request)
        self._asked_s = time.monotonic()
        return reply

    def _request(self, request: Request) -> Reply | None:
        """Ask the conductor, from any thread."""
        assert self._bus is not None
        data = self._bus.request(route_key(request), encode(request), REQUEST_TIMEOUT_S)
        if data is None:
            return None
        try:
            return decode(data, Reply)
        except WireError as error:
            return Reply(v=SCHEMA_VERSION, epoch=0, error=str(error))

    def _turn(self) -> None:
        assert self._delivery is not None
        try:
            event = self._inbox.get(timeout=TURN_S)
        except queue.Empty:
            event = None
        now = time.monotonic_ns()
        if self.rig is not None:
            self.rig.look()
        if event is not None:
            self._carry_out(self.handle(event, now))
        if self.rig is not None and self._options.memory_gb and now >= self._memory_at_ns:
            self._memory_at_ns = now + MEMORY_PERIOD_NS
            self._carry_out(self.core.on_memory(self.rig.memory_bytes(), now))
        rig = self.core.rig
        if self.rig is not None and rig is not None and not rig.ready and self.rig.is_fetching(now):
            self._carry_out(self.core.on_preparing(now))
        self._carry_out(self.core.on_time(now, self._stack_words))
        leases = (held.lease for held in self.core.held.values())
        self._resources.work = work_of(
            lease for lease in leases if not self._delivery.holds(lease.token)
        )

    def handle(self, event: Any, now: int) -> list[Effect]:
        """What follows from an event at a time [ns]."""
        core = self.core
        match event:
            case _Answered(request, reply):
                return core.on_reply(request, reply, now)
            case _Undeliverable(error):
                return core.leave(error)
            case _Mistaken(error):
                self._mistake = error
                return core.leave()
            case _Heard():
                core.silence.heard()
                return []
            case _PortFree():
                return core.on_port_free(now)
            case _Signalled(name):
                return core.on_drain(name, now)
            case (rig, _) if rig is not self.rig:
                return []  # words of a rig that was stopped meanwhile
            case (_, Listening(endpoint, view)):
                return self._start_others(endpoint, view, now)
            case (_, RefusedPeer(line)):
                _log(line)
                return []
            case (_, RecorderEnded(detail, endpoint)):
                _log(f"recorder ended: {detail}; {self._record_on(endpoint)}")
                return []
            case (_, Building()):
                return core.on_preparing(now)
            case (_, Built(transport, notes)):
                _log("\n".join([f"rig ready, frames by {transport}", *notes]))
                return core.on_rig_ready()
            case (_, Progress(tokens, ticks, waiting, over)):
                return core.on_progress(tokens, ticks, now, waiting, over)
            case (_, Intervened(token, note)):
                return core.on_intervened(token, note, now)
            case (_, Faulted(why)):
                return core.on_stack_failed(why, now)
            case (_, StackLeft(why)):
                return core.on_stack_failed(why, now, left=True)
            case (rig, IntervenedDone(result, changes)):
                rig.over(result.token)
                return core.on_intervened_done(result, changes, now)
            case (rig, CaseDone(result)):
                rig.over(result.token)
                result = structs.replace(result, protection=rig.protection)
                if result.outcome == "failed" and (words := self._stack_words()):
                    reasons = [*result.reasons, words.lstrip("; ")]
                    result = structs.replace(result, reasons=reasons)
                return core.on_done(result, now)
            case (_, Broken("refused", detail)):
                return core.on_rig_died("refused", detail, now)
            case (_, Broken(reason, detail)):
                return core.on_rig_died(reason, detail + self._stack_words(), now)
            case (_, RigDied(reason, detail)):
                return core.on_rig_died(reason, detail, now)
            case _:
                return []

    def _start_rig(self, lease: Lease, slots: int) -> None:
        port, turn = port_of(lease.case), None
        if port and (turn := turn_at(port)) is None:
            threading.Thread(target=self._await_turn, args=(port,), daemon=True).start()
            self._carry_out(self.core.on_port_taken(port, time.monotonic_ns()))
            return
        try:
            loading, self._loading = self._loading, None
            self.rig = RigProcess(self._options, lease, slots, self._inbox, loading, turn)
        except OSError as error:
            if turn is not None:
                turn.close()
            # It dies in the next turn: effects must not call for more of them.
            self._inbox.put((None, RigDied("released", f"no rig: {error.strerror}")))

    def _await_turn(self, port: int) -> None:
        await_turn(port)
        self._inbox.put(_PortFree())

    def _start_others(self, endpoint: str, view: str, now: int) -> list[Effect]:
        """The simulator listens: start the stack, and a recorder that reads at ``view``."""
        assert self.rig is not None
        try:
            held = self.core.held.values()
            self.rig.start_stack(endpoint, [held_case.lease.case for held_case in held])
            if view:
                self.rig.start_recorder(view)
        except OSError as error:
            return self.core.on_rig_died("released", f"no stack: {error.strerror}", now)
        return []

    def _record_on(self, endpoint: str) -> str:
        """Another recorder in place of one that ended; what comes of it."""
        assert self.rig is not None
        with contextlib.suppress(OSError):
            if self.rig.start_recorder(endpoint):
                return "running cases lose their recordings, another recorder takes the next ones"
        return "cases go on, this rig's are not recorded any more"

    def _stack_words(self) -> str:
        """What a stack of another process said last, to be added to a reason."""
        last_words = self.rig.stack_words() if self.rig else ""
        return f"; the stack's log ends: {last_words}" if last_words else ""

    def _failures(self, leases: Sequence[Lease], reason: str) -> list[Result]:
        """Results of cases whose stack failed before they began."""
        assert self._delivery is not None
        printed = self.rig.printed(leases) if self.rig is not None else [None] * len(leases)
        results = []
        for lease, output in zip(leases, printed, strict=True):
            try:
                results.append(write_failure(self._delivery.localized(lease), reason, output))
            except TwinError as error:
                _log(str(error))
                results.append(failure(lease, reason))
        return results

    def _keep_logs(self, leases: Sequence[Lease], end: str) -> None:
        """What the stack printed, for attempts that end without a result."""
        assert self._delivery is not None
        if self.rig is None:
            return
        for lease, output in zip(leases, self.rig.printed(leases), strict=True):
            try:
                write_log(self._delivery.localized(lease), end, output)
            except TwinError as error:
                _log(str(error))
                return

    def _carry_out(self, effects: list[Effect]) -> None:
        assert self._delivery is not None
        for effect in effects:
            match effect:
                case Ask(request):
                    self._requests.put(request)
                case StartRig(lease, slots):
                    lease = self._delivery.localized(lease)
                    self._start_rig(lease, slots)
                case StopRig():
                    if self.rig is not None:
                        self.rig.stop()
                        self.rig = None
                case AssignLease(lease):
                    if self.rig is not None:
                        self.rig.assign(self._delivery.localized(lease))
                case AbandonToken(token):
                    if self.rig is not None:
                        self.rig.abandon(token)
                case FailCase(token, reason):
                    if self.rig is not None:
                        self.rig.fail(token, reason)
                case FailUnbegun(leases, reason):
                    now = time.monotonic_ns()
                    for result in self._failures(leases, reason):
                        self._carry_out(self.core.on_done(result, now))
                case KeepLogs(leases, end):
                    self._keep_logs(leases, end)
                case Say(line):
                    _log(line)
                case SpoolWrite(token, data):
                    if self._delivery.holds(token):
                        continue  # without its files, which end with us, it is worth nothing
                    try:
                        self._spool.write(token, data)
                    except OSError as error:
                        _log(f"{storage_error(error, 'spool')}; results wait in memory")
                case SpoolForget(token):
                    self._spool.forget(token)
                case Leave(error, silent):
                    self._error, self._silent = error, silent
                    self._left = True


def _walltime_end_ns(walltime_s: float | None) -> int | None:
    """The end of the allocation, less the time to leave, on the clock of the main loop [ns]."""
    if walltime_s is None:
        return None
    return time.monotonic_ns() + int((walltime_s - HAND_BACK_S) * SECOND_NS)


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
