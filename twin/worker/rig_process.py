"""A rig: the simulator and the stack process, started and watched by the worker."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import secrets
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import msgspec

from schemas.case import Case
from schemas.kinds.bridge import bridges
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease, Release
from schemas.wire.expected import expected_of
from schemas.wire.interventions import RecordedAction
from twin.base.errors import EXIT_UNFINISHED
from twin.base.gpu.first_use import apart
from twin.base.process import (
    RigChild,
    bound_log,
    end,
    how_it_ended,
    last_lines,
    left_by_itself,
    raised_in,
    spawn,
)
from twin.fabric.endpoint import is_loopback, is_tls, to_listen
from twin.fabric.keys.rig_keys import RigKeys
from twin.fabric.port_turn import TURN_VARIABLE
from twin.fabric.rig_folder import SEEN_IN_CONTAINERS, RigFolder
from twin.rig.pipe import (
    Abandon,
    Assign,
    BuildRig,
    Close,
    Drain,
    Drained,
    Fail,
    Unpacker,
    Upward,
    pack,
)
from twin.rig.sim_process import start_simulator
from twin.rig.stack_output import HEAD_BYTES, Kept, StackOutput
from twin.sandbox.inside import PROCESSES_MAX
from twin.sandbox.start import Inside, own_code
from twin.worker.announcement import Announcement
from twin.worker.protection import Protection, protection
from twin.worker.stack_process import Loading, may_run, start_stack, tell_stack, threads

FEED_GRACE_S = 8.0
"""Longest wait for a recorder that still gets samples, when its rig ends; below the ttl [s]."""

STOPPED_GRACE_S = 0.5
"""Longest time that a recorder may stand still by SIGSTOP meanwhile [s]."""

FILE_GRACE_S = 1.0
"""Longest wait after that for the recorder to finish its files without the rest [s]."""

FOREIGN_GRACE_S = 5.0
"""Longest wait for the end of everything that a foreign stack started [s]."""

FETCH = "-m hpc fetch repository "
"""Part of the command line of the process that fetches and builds a stack's files."""

FETCH_PERIOD_NS = 1_000_000_000
"""Period in which that process is looked for [ns]."""

RECORDERS_MAX = 5
"""Recorders of one rig, one in place of the other, before its cases go on without."""

LOG_PERIOD_S = 0.2
"""How often the size of a stack's log is looked at [s]."""

DRAIN_GRACE_S = 12.0
"""Longest wait for the results of cases that were over when the stack ended; a simulator that can
answer does so earlier [s]."""

if TYPE_CHECKING:
    from twin.worker.options import WorkerOptions


@dataclass(frozen=True, slots=True)
class RigDied:
    """A process of the rig ended without a word."""

    reason: Release
    detail: str


@dataclass(frozen=True, slots=True)
class StackLeft:
    """The stack ended by itself, with an exit code, while its simulator was well."""

    reason: str


@dataclass(frozen=True, slots=True)
class RecorderEnded:
    """The recorder ended before its rig; nothing but recordings of running cases suffers."""

    detail: str
    endpoint: str
    """Endpoint at which the recorder read."""


class RigProcess:
    """The processes of one rig: simulator, stack and, if asked for, recorder.

    Messages go to ``inbox`` as ``(self, message)``.
    """

    def __init__(
        self,
        options: WorkerOptions,
        lease: Lease,
        slots: int,
        inbox: queue.SimpleQueue[Any],
        loaded: Loading | None = None,
        turn: socket.socket | None = None,
    ) -> None:
        """Make a rig for a first lease.

        Args:
            options: of the worker.
            lease: the first one.
            slots: cases that it drives at once.
            inbox: for messages.
            loaded: processes that wait to be told what to do.
            turn: at the port of its script, which ends with the rig.
        """
        self._turn = turn
        self._options = options
        self._lease = lease
        self._inbox = inbox
        self._slots = slots
        self._id = secrets.token_hex(8)
        self._stopped = False
        self._drained = threading.Event()
        self._lock = threading.Lock()
        self._recorder: subprocess.Popen[bytes] | None = None
        self._recorders = 0
        """Number of recorders started."""
        self._announced: Announcement | None = None
        self._fetches, self._fetch_seen_ns = False, 0
        # A case with which a rig died must not end what others compute on the GPU, nor they it.
        self._environment = apart(options.device) if lease.alone else {}
        if self._environment and loaded:
            loaded.discard()
            loaded = None
        remote = lease.case.rig.placement == "node"
        self._folder = None if remote else _folder_of(lease.case, loaded)
        if remote and loaded:
            loaded.folder.close()
        stack = loaded and _usable(loaded.stack, may_run(lease.case))
        self._stack = stack.process if stack else None
        self._crowded = False
        """Whether the stack ran too many processes, and was ended for that."""
        self.protection = stack.protection if stack else ""
        """Sandbox that keeps the stack from the machine; empty: it has not been started."""
        if stack:
            stack.log.close()
        self._stack_log = loaded.stack_log if loaded else tempfile.TemporaryFile()  # noqa: SIM115
        self._recorder_log = tempfile.TemporaryFile()  # noqa: SIM115
        listen = self._listens_at()
        self._keys = RigKeys(self._id) if is_tls(listen) else None
        inline = lease.case.rig.placement == "inline"
        simulator = loaded and _usable(loaded.simulator, not inline)
        simulator = simulator or start_simulator(
            options.device,
            self._stack_log,
            {**(threads() if inline else {}), **self._environment},
        )
        self._simulator, self._log = simulator.process, simulator.log
        log = None if remote else self._log if inline else self._stack_log
        self._output = StackOutput(None if log is None else log.fileno())
        self._write(pack(self._building(listen)))
        threading.Thread(target=self._read, name="rig", daemon=True).start()

    def _listens_at(self) -> str:
        """Where the rig's session listens."""
        if self._folder is not None:
            return self._folder.drive
        listen = self._options.drive_listen
        # A rig has keys of its own: whatever the conductor speaks, it is TLS beyond loopback.
        keyed = self._options.key_path is not None or not is_loopback(listen)
        return to_listen(listen, keyed=keyed)

    def _building(self, listen: str) -> BuildRig:
        """First message to the simulator."""
        options, case = self._options, self._lease.case
        view = options.view or ViewMode(case.rig.view)
        if case.rig.keep == "none":
            view = view.unrecorded
        elsewhere = case.rig.placement in ("node", "inline")  # or nowhere: its words are among ours
        return BuildRig(
            lease=self._lease,
            rig=self._id,
            listen=listen,
            namespace=self._namespace,
            slots=self._slots,
            device=options.device,
            view=view,
            view_namespace=options.namespace,
            view_connect=options.connect,
            key=str(options.key_path or ""),
            rig_key=self._keys.simulator_key if self._keys else b"",
            output=-1 if elsewhere else self._stack_log.fileno(),
        )

    @property
    def _namespace(self) -> str:
        return f"{self._options.namespace}/{self._id}"

    @property
    def _key(self) -> tuple[str, ...]:
        """Children are told where the key lies, never the key."""
        return ("--key", str(self._options.key_path)) if self._options.key_path else ()

    def assign(self, lease: Lease, replay: Sequence[RecordedAction] = ()) -> None:
        """Hand a lease to the simulator; ``replay``: with the interventions of its journal."""
        self._output.begin(lease.token, lease.case.id)
        self._write(pack(Assign(lease, list(replay))))

    def abandon(self, token: int) -> None:
        """Stop working on a token."""
        self._output.forget(token)
        self._write(pack(Abandon(token)))

    def fail(self, token: int, reason: str) -> None:
        """End the case of a token as ``failed``."""
        self._write(pack(Fail(token, reason)))

    def over(self, token: int) -> None:
        """The case of a token has ended, and the simulator has written its log."""
        self._output.forget(token)

    def look(self) -> None:
        """Take in what the stack prints."""
        self._output.look()

    def printed(self, leases: Sequence[Lease]) -> list[Kept | None]:
        """What the stack printed for attempts that end without a result; None: on another host."""
        for lease in leases:
            self._output.begin(lease.token, lease.case.id, again=True)
        return [self._output.end(lease.token) for lease in leases]

    def memory_bytes(self) -> dict[str, int]:
        """Resident memory of the processes and all that they started [bytes]."""
        children = {
            "simulator": self._simulator,
            "stack": self._stack,
            "recorder": self._recorder,
        }
        return {
            name: _resident_bytes(child.pid)
            for name, child in children.items()
            if child is not None
        }

    def is_fetching(self, now_ns: int) -> bool:
        """Whether the files of the stack are being fetched and built; looked at once per second."""
        foreign = self._lease.case.rig.foreign
        if foreign is None or foreign.repository is None or self._stack is None:
            return False
        if now_ns >= self._fetch_seen_ns + FETCH_PERIOD_NS:
            self._fetch_seen_ns = now_ns
            self._fetches = runs_fetch(self._stack.pid)
        return self._fetches

    def stop(self) -> None:
        """End all processes and remove what they left."""
        with self._lock:
            self._stopped = True
        self._finish_recordings()
        children = [c for c in (self._simulator, self._stack, self._recorder) if c is not None]
        for child in children:
            # What keeps watch over a foreign stack has to end all that the stack started, unless a
            # sandbox does.
            watches = child is self._stack and self._lease.case.rig.foreign is not None
            if not watches or type(child) is Inside:
                child.kill()  # nothing of value is in there: results are on disk
        for child in children:  # a GPU takes its time to let go, of both at once
            end(child, FOREIGN_GRACE_S)
        if self._announced is not None:
            self._announced.remove()
        if self._keys is not None:
            self._keys.close()
        if self._folder is not None:
            self._folder.close()
        self._log.close()
        self._stack_log.close()
        self._recorder_log.close()
        if self._turn is not None:
            self._turn.close()

    def stack_words(self) -> str:
        """The last lines of a foreign stack's log; a class says its reason by itself."""
        return "" if self._lease.case.rig.foreign is None else last_lines(self._stack_log)

    def _write(self, data: bytes) -> None:
        assert self._simulator.stdin is not None
        try:
            os.write(self._simulator.stdin.fileno(), data)
        except OSError:
            pass  # it died; the reader thread tells

    def _read(self) -> None:
        assert self._simulator.stdout is not None
        descriptor = self._simulator.stdout.fileno()
        unpacker = Unpacker(Upward)
        while True:
            try:
                # An inline stack may print without end before the simulator says anything.
                while not select.select([descriptor], [], [], LOG_PERIOD_S)[0]:
                    self._bound(self._log)
                data = os.read(descriptor, 65536)
            except OSError:  # the rig is stopped, and its pipe closed
                data = b""
            if not data:
                break
            self._bound(self._log)  # a few times per second: it reports its progress
            for message in unpacker.feed(data):
                if isinstance(message, Drained):
                    self._drained.set()
                else:
                    self._inbox.put((self, message))
        self._drained.set()
        self._tell_end(self._simulator, "simulator", self._log)

    def start_stack(self, endpoint: str, cases: Sequence[Case] = ()) -> None:
        """The simulator listens: start the stack, or announce the rig to a remote one.

        ``cases``: those that will be the first, as far as they are known.
        """
        expected = expected_of(cases or [self._lease.case], self._options.device)
        arguments = [
            *("--connect", endpoint, "--rig", self._id, "--namespace", self._namespace),
            *("--slots", str(self._slots), "--stack", self._lease.case.rig.stack),
            *("--parameters", json.dumps(self._lease.case.rig.parameters)),
            *("--expected", msgspec.json.encode(expected).decode()),
        ]
        if self._lease.case.rig.foreign is not None:
            foreign = msgspec.json.encode(self._lease.case.rig.foreign).decode()
            arguments += ["--foreign", foreign]
        if self._lease.case.rig.source.is_known:
            source = msgspec.json.encode(self._lease.case.rig.source).decode()
            arguments += ["--source", source]
        if self._lease.case.rig.placement == "inline":
            self.protection = self._protection().said
            return  # the simulator has it in its own process
        if self._lease.case.rig.placement == "node":
            self._announced = Announcement(Path(self._options.join_dir), self._id)
            self._announced.write(arguments, self._keys)
            self.protection = self._protection().said
            return
        assert self._folder is not None
        if self._stack is not None and not tell_stack(self._stack, arguments):
            self._stack.kill()
            end(self._stack)
            self._stack = None
            self.protection = ""
        turn = {} if self._turn is None else {TURN_VARIABLE: str(port_of(self._lease.case))}
        variables = {**self._environment, **turn}
        if self._stack is None:
            shield = self._protection()
            self.protection = shield.said
            self._stack = start_stack(
                arguments, self._stack_log, variables, shield.view, later=shield.later
            )
        threading.Thread(target=self._watch_stack, name="stack", daemon=True).start()

    def _protection(self) -> Protection:
        hidden = [Path(self._lease.out), *(path.parent for path in self._secrets)]
        folder = self._folder.path if self._folder else None
        return protection(self._lease.case, self._options.device, folder, hidden)

    @property
    def _secrets(self) -> list[Path]:
        return [self._options.key_path] if self._options.key_path else []

    def start_recorder(self, endpoint: str) -> bool:
        """The simulator's view feed listens: start a recorder beside it, or another one in place of
        one that ended. False: that has happened too often."""
        if self._recorders >= RECORDERS_MAX:
            return False
        self._recorders += 1
        self._recorder = spawn(
            [
                *(sys.executable, "-m", "viewer", "record", "--connect", endpoint),
                *("--rig", self._id, "--namespace", self._options.namespace, *self._key),
            ],
            log=self._recorder_log,
        )
        watch = threading.Thread(
            target=self._watch_recorder, args=(self._recorder, endpoint), daemon=True
        )
        watch.start()
        return True

    def _watch_recorder(self, recorder: subprocess.Popen[bytes], endpoint: str) -> None:
        code = recorder.wait()
        with self._lock:
            if self._stopped:
                return
            tail = last_lines(self._recorder_log)
        detail = how_it_ended(code)
        self._inbox.put((self, RecorderEnded(_joined(detail, tail), endpoint)))

    def _finish_recordings(self) -> None:
        """A short grace for the recorder; a frozen one loses its recordings, nothing else."""
        recorder = self._recorder
        if recorder is None or recorder.poll() is not None:
            return
        self._write(pack(Close()))
        try:
            if self._simulator.poll() is None:
                _wait_unless_stopped(recorder)
                return
        except subprocess.TimeoutExpired:
            pass
        assert recorder.stdin is not None
        recorder.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            recorder.wait(FILE_GRACE_S)

    def _watch_stack(self) -> None:
        assert self._stack is not None
        _wait_beside(self._stack, self._look_at_stack)
        with self._lock:
            stopped = self._stopped
        if not stopped:
            # Cases that are over are no victims of the stack: their results come first.
            self._write(pack(Drain()))
            self._drained.wait(DRAIN_GRACE_S)
        self._tell_end(self._stack, "stack", self._stack_log)

    def _look_at_stack(self) -> None:
        """While it runs: neither its log nor the number of its processes grows without end."""
        self._bound(self._stack_log)
        if isinstance(self._stack, Inside) and not self._crowded and self._stack.is_crowded():
            self._crowded = True
            self._stack.kill()

    def _bound(self, log: IO[bytes]) -> None:
        """Keep a log from filling the disk."""
        with self._lock:
            if not self._stopped:  # then it is closed
                bound_log(log, self._output.starts(), HEAD_BYTES)

    def _tell_end(self, child: subprocess.Popen[bytes], name: str, log: IO[bytes]) -> None:
        code = own_code(child, child.wait())
        with self._lock:
            if self._stopped:
                return
            tail = last_lines(log)
            last_words = _said(log) if name == "stack" else ""
        if name == "stack" and self._crowded:
            tail = f"it runs more than {PROCESSES_MAX} processes"
        # SIGKILL that nobody of us sent is the kernel's out-of-memory killer or an operator.
        detail = f"{name} {how_it_ended(code)}"
        foreign = self._lease.case.rig.foreign
        # A bridge says so if another rig of this host is at its port: nobody's fault.
        waits = name == "stack" and foreign and foreign.bridge != "none"
        reason: Release = "released" if waits and code == EXIT_UNFINISHED else "crash"
        # The simulator has answered since: the stack did not leave because of it.
        if name == "stack" and left_by_itself(code) and self._simulator.poll() is None:
            line = last_lines(log, 1)  # of our host, about a stack that it could not load
            why = line if line.startswith("stack: ") else _joined(detail, last_words)
            self._inbox.put((self, StackLeft(why)))
            return
        self._inbox.put((self, RigDied(reason, _joined(detail, tail))))


def port_of(case: Case) -> int:
    """The port at which the script of ``case`` listens on this host; 0: at none."""
    if case.rig.foreign is None or case.rig.placement != "worker":
        return 0
    bridge = bridges().get(case.rig.foreign.bridge)
    if bridge is None or not bridge.port:
        return 0
    port = case.rig.parameters.get("port", bridge.port)
    return port if isinstance(port, int) else 0


def _said(log: IO[bytes]) -> str:
    """Why a stack left, as far as its log says so: what was raised, or the last lines."""
    return raised_in(log) or last_lines(log)


def _joined(detail: str, last_words: str) -> str:
    return f"{detail}: {last_words}" if last_words else detail


def runs_fetch(pid: int) -> bool:
    """Whether the host of a stack waits for ``hpc fetch``."""
    import psutil  # takes 10 ms, and workers of cases that simulate nothing load this module

    with contextlib.suppress(psutil.Error):
        for child in psutil.Process(pid).children():
            if FETCH in " ".join(child.cmdline()):
                return True
    return False


def _wait_beside(child: subprocess.Popen[bytes], look: Callable[[], None]) -> None:
    """Wait for the end of a child, and ``look`` around meanwhile."""
    try:
        descriptor = os.pidfd_open(child.pid)
    except ProcessLookupError:  # it has ended, and somebody else waited for it
        return
    try:
        while not select.select([descriptor], [], [], LOG_PERIOD_S)[0]:
            look()
    finally:
        os.close(descriptor)


def _folder_of(case: Case, loaded: Loading | None) -> RigFolder:
    """Where the simulator and the stack of ``case`` meet: the folder that those know that loaded
    ahead, unless a container would not show it."""
    in_container = case.rig.foreign is not None and case.rig.foreign.image is not None
    if loaded is not None and not in_container:
        return loaded.folder
    if loaded is not None:
        loaded.folder.close()
    return RigFolder(SEEN_IN_CONTAINERS if in_container else None)


def _usable(child: RigChild, wanted: bool) -> RigChild | None:
    """The child that waits; None: it is not wanted, or it ended meanwhile, and nothing is left."""
    if wanted and child.process.poll() is None:
        return child
    child.discard()
    return None


def _resident_bytes(pid: int) -> int:
    """Memory of a process and its descendants; 0 when it is gone [bytes]."""
    import psutil  # late, see runs_fetch

    total = 0
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(pid)
        for member in [process, *process.children(recursive=True)]:
            with contextlib.suppress(psutil.Error):
                total += member.memory_info().rss
    return total


def _wait_unless_stopped(recorder: subprocess.Popen[bytes]) -> None:
    """Wait for the end of a recorder that is at work; a stopped one is not waited for.

    Raises:
        TimeoutExpired: it still runs.
    """
    import psutil  # late, see runs_fetch

    stopped = 0.0
    until_s = time.monotonic() + FEED_GRACE_S
    while True:
        try:
            recorder.wait(STOPPED_GRACE_S / 5)
            return
        except subprocess.TimeoutExpired:
            if time.monotonic() >= until_s or stopped >= STOPPED_GRACE_S:
                raise
        with contextlib.suppress(psutil.NoSuchProcess):
            still = psutil.Process(recorder.pid).status() == psutil.STATUS_STOPPED
            stopped = stopped + STOPPED_GRACE_S / 5 if still else 0.0
