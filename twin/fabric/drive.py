"""The drive plane in lockstep: the two ends of a rig.

The simulator publishes the sensors of one ``seq`` and a tick that names them; the stack answers
with one message of commands. A seq without an answer is published again; the stack answers a
repeated seq from its cache. So the exchange survives loss, delay and duplication, and neither end
ever guesses.
"""

from __future__ import annotations

import contextlib
import math
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas import DRIVE_MINOR, SCHEMA_VERSION
from schemas.messages import Commands, Episode, Frame, Ready, Tick
from schemas.wire import topics
from schemas.wire.codec import ATTACHMENT_BYTES_MAX, MESSAGE_BYTES_MAX, WireError, decode, encode
from twin.base.errors import InfrastructureError, RefusedError, StackFaultError
from twin.fabric.answers import Answers
from twin.fabric.bus import Bus, Sample
from twin.fabric.endpoint import is_socket
from twin.fabric.frames import HEADER_BYTES, FrameBuffer, open_frames
from twin.fabric.link import LinkWatch, ReadingWatch

if TYPE_CHECKING:
    from twin.base.gpu.cuda import DeviceFrame, DeviceMemory, SharedProbe

READY_PERIOD_S = 0.05
"""Period in which each side repeats ``ready`` until it is answered [s]."""

RESEND_S = 1.0
"""A seq without commands is published again after this long [s]."""

WAITING_MAX = 1000
"""Most messages of the stack that wait for the simulator."""

WAITING_BYTES_MAX = 64 << 20
"""Most bytes of the stack that wait for the simulator."""

UNDER_WAY_BYTES_MAX = 32 << 20
"""Most bytes of the stack that came and are no message yet [bytes]."""

STACK_BYTES_MAX = 64 << 20
"""Largest message of a stack that the simulator's session puts together; the rest of a larger one
is dropped as it comes, so this bounds what it costs in memory [bytes]."""

STACK_WAITING_MAX = 10_000
"""Most messages of the simulator that wait for the stack; more are dropped, since a seq that was
not answered is published again."""

STACK_WAITING_BYTES_MAX = 2 << 30
"""Most bytes of the simulator that wait for the stack: two of the largest frames."""

SEQS_MAX = 16
"""Most seqs of which a stack keeps a part; the simulator waits for each before the next."""

PARTS_MAX = 1024
"""Most messages of a kind that a seq may have."""

READY_WAITING_MAX = 10
"""A stack's ``ready`` is left out while so many messages wait: it says so again and again."""

REFUSE_S = 60.0
"""Longest time that a stack repeats why it is none of the campaign [s]."""

LOOK_S = 0.1
"""How often the simulator looks around while it waits for the stack [s]."""

FRAME_BYTES_MAX = 1 << 30
"""Largest array in one message [bytes]."""

DTYPES = (
    "|u1",
    "|i1",
    "|b1",
    *(f"<{kind}{size}" for kind in "iu" for size in (2, 4, 8)),
    "<f4",
    "<f8",
)
"""What an array in a message may be made of, as NumPy writes it."""

AXES_MAX = 8
"""Most axes of an array in a message."""


Transport = Literal["device", "memory", "bytes", "inline"]
"""How large arrays reach the stack: in a GPU's memory, in a mapped file, as payload, or not at all
because the stack runs in the simulator's process."""

DEVICES_MAX = 64
"""Most arrays in GPU memory that a stack keeps open: a rig has a few."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One sensor message: attachment, and the array unless it lies in shared memory."""

    name: str
    frame: Frame
    payload: bytes


@dataclass(frozen=True, slots=True)
class Incoming:
    """Everything the stack gets for one seq."""

    tick: Tick
    episodes: list[Episode]
    sensors: dict[str, NDArray[Any] | DeviceFrame]
    counts: dict[str, NDArray[np.int32]]


class SimulatorEnd:
    """The simulator's end: offers frames, publishes a seq, waits for its commands."""

    def __init__(
        self,
        bus: Bus,
        rig: str,
        slots: int,
        frames: FrameBuffer | None,
        *,
        probe: SharedProbe | None = None,
        device: str = "",
        resend_s: float = RESEND_S,
    ) -> None:
        """Open the simulator's end.

        Args:
            bus: session of the rig.
            rig: its id.
            slots: of the rig.
            frames: buffer to offer; None: there is none.
            probe: in the GPU's memory, if frames there can be shared.
            device: ``cuda:N`` of the probe.
            resend_s: a seq without an answer is published again after this long [s].
        """
        self._bus = bus
        self._probe = probe
        self._device = device if probe else ""
        self._resend_s = resend_s
        self._rig = rig
        self._slots = slots
        self._frames = frames
        self._inbox: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self.transport: Transport = "bytes"
        """Transport that the stack chose of those offered."""
        self.reads: frozenset[str] | None = None
        """Sensor messages that the stack looks at; None: all."""
        self.resent = 0
        """Seqs published again."""
        self._fault = ""
        self._answers = Answers()
        # Each counted by one thread: what arrived, and what was looked at [bytes].
        self._arrived, self._read = 0, 0
        self._link, self._link_seen_s = LinkWatch(bus.endpoints), time.monotonic()
        socket = any(map(is_socket, bus.endpoints))
        self._reading = ReadingWatch() if socket else None
        self._came = 0
        """Bytes of all messages, also those that were left out."""
        self._messages = 0
        """Number of all messages."""
        bus.subscribe(topics.READY.key.format(rig=rig, side="stack"), self._take_ready)
        bus.subscribe(topics.COMMAND.key.format(rig=rig), self._take)
        bus.announce(topics.SIMULATOR_ALIVE.key.format(rig=rig))

    def _take_ready(self, sample: Sample) -> None:
        """Keep a ``ready``, unless many wait as they do while the first frame is drawn."""
        self._came += len(sample.payload)
        self._messages += 1
        if self._inbox.qsize() < READY_WAITING_MAX or len(sample.payload) > MESSAGE_BYTES_MAX:
            self._keep(sample)

    def _take(self, sample: Sample) -> None:
        """Keep a command."""
        self._came += len(sample.payload)
        self._messages += 1
        self._keep(sample)

    def _keep(self, sample: Sample) -> None:
        """Keep a message of the stack; one that is hostile must not fill our memory."""
        if len(sample.payload) > MESSAGE_BYTES_MAX:
            size = len(sample.payload)
            self._fault = (
                f"stack: message of {size} bytes, at most {MESSAGE_BYTES_MAX} are accepted"
            )
        elif self._inbox.qsize() >= WAITING_MAX:
            self._fault = f"stack: more than {WAITING_MAX} messages wait; one answers a tick"
        elif self._arrived - self._read > WAITING_BYTES_MAX:
            self._fault = f"stack: more than {WAITING_BYTES_MAX} bytes wait; one answers a tick"
        else:
            self._arrived += len(sample.payload)
            self._inbox.put(sample)

    def handshake(self, on_wait: Callable[[], None]) -> None:
        """Repeat ``ready`` until the stack answers; ``on_wait`` may raise to give up."""
        key = topics.READY.key.format(rig=self._rig, side="simulator")
        offer = Ready(
            v=SCHEMA_VERSION,
            role="simulator",
            rig=self._rig,
            slots=self._slots,
            frames=self._frames.path if self._frames else "",
            frames_bytes=self._frames.size if self._frames else 0,
            nonce=self._frames.nonce if self._frames else "",
            minor=DRIVE_MINOR,
            gpu=self._device,
            gpu_handle=self._probe.handle if self._probe else b"",
            gpu_nonce=self._probe.nonce if self._probe else "",
        )
        while True:
            self._bus.publish(key, encode(offer))
            sample = self._receive(READY_PERIOD_S)
            on_wait()
            self._check_link(time.monotonic())
            if sample is None or not sample.key.endswith("/control/stack"):
                continue
            try:
                answer: Ready = decode(sample.payload, Ready)
            except WireError as error:
                raise InfrastructureError(f"stack: {error}") from None
            if answer.refused:
                raise RefusedError(answer.refused)
            if answer.seen:
                if mistake := topics.reads_mistake(answer.reads or ()):
                    raise StackFaultError(f"stack: {mistake}")
                self.reads = None if answer.reads is None else frozenset(answer.reads)
                self.transport = "memory" if answer.shared else "bytes"
                if answer.on_gpu and self._probe is not None:
                    self.transport = "device"
                self._bus.publish(key, encode(msgspec.structs.replace(offer, seen=True)))
                return

    def exchange(
        self,
        seq: int,
        tick: Tick,
        sensors: list[Outgoing],
        episodes: list[Episode],
        on_wait: Callable[[], None],
    ) -> Commands:
        """Publish one seq and return its commands; ``on_wait`` runs while waiting and may raise.

        Raises:
            StackFaultError: the stack answers what it was not asked.
            InfrastructureError: the link ends, or more comes than a stack may send.
        """
        if self._reading is not None:
            self._reading.begin()
        self._answers.asked(seq)
        self.publish(tick, sensors, episodes)
        sent = looked = time.monotonic()
        while True:
            sample = self._receive(min(LOOK_S, self._resend_s))
            now = time.monotonic()
            self._check_link(now)
            # Also beside a stack that says a lot and never what it was asked for.
            if sample is None or now - looked >= LOOK_S:
                on_wait()
                looked = now
            if sample is None:
                if now - sent >= self._resend_s:
                    self.resent += 1
                    self._answers.asked(seq)
                    self.publish(tick, sensors, episodes)
                    sent = time.monotonic()
                continue
            commands = _commands_in(sample)
            if commands is None:
                continue
            if commands.seq == seq:
                return commands
            self._answers.other(commands.seq, seq)

    def answered(self, seq: int | None, timeout_s: float) -> Commands | None:
        """The commands for ``seq`` (None: whatever comes is late) if they come within
        ``timeout_s``, without asking again."""
        if self._reading is not None:
            self._reading.begin()
        until_s = time.monotonic() + timeout_s
        for _ in range(WAITING_MAX):  # a stack that says a lot holds nobody up
            sample = self._receive(max(0.0, until_s - time.monotonic()))
            self._check_link(time.monotonic())
            if sample is None:
                return None
            commands = _commands_in(sample)
            if commands is not None and commands.seq == seq:
                return commands
        return None

    def _check_link(self, now_s: float) -> None:
        """Raise :class:`InfrastructureError` if more came than a stack may send. A message that is
        too large never arrives; the link tells of it while it comes."""
        if now_s - self._link_seen_s >= LOOK_S and not self._fault:
            self._link_seen_s = now_s
            self._fault = self._excess(now_s)
        if self._fault:
            raise InfrastructureError(self._fault)

    def _excess(self, now_s: float) -> str:
        most = f"at most {MESSAGE_BYTES_MAX} {{}}are accepted"
        if self._reading is not None:
            in_vain = self._reading.is_in_vain(self._messages, now_s)
            said = "stack: it sends and sends, and no message comes of it; "
            return said + most.format("bytes in one ") if in_vain else ""
        if self._link.excess(self._came) <= UNDER_WAY_BYTES_MAX:
            return ""
        return f"stack: a message of more than {UNDER_WAY_BYTES_MAX} bytes, " + most.format("")

    def publish(self, tick: Tick, sensors: list[Outgoing], episodes: list[Episode]) -> None:
        """Publish one seq, and wait for nothing."""
        for episode in episodes:
            self._put(topics.EPISODE, encode(episode))
        for sensor in sensors:
            key = topics.sensor_key(self._rig, sensor.name)
            self._bus.publish(key, sensor.payload, encode(sensor.frame), block=True)
        self._put(topics.TICK, encode(tick))

    def _put(self, topic: topics.Topic, payload: bytes) -> None:
        self._bus.publish(topic.key.format(rig=self._rig), payload, block=topic.block)

    def _receive(self, timeout_s: float) -> Sample | None:
        try:
            sample = self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            return None
        self._read += len(sample.payload)
        return sample


def _commands_in(sample: Sample) -> Commands | None:
    """The stack's commands, or None if it says something else, such as a late ``ready``."""
    if not sample.key.endswith("/command"):
        return None
    try:
        commands: Commands = decode(sample.payload, Commands)
    except WireError as error:
        raise StackFaultError(f"stack: {error}") from None
    check_answer(commands)
    return commands


def check_answer(commands: Commands) -> None:
    """Do nothing if the stack can go on.

    Raises:
        RefusedError: it is not what the campaign was submitted with.
        StackFaultError: it cannot, and that is its own doing.
        InfrastructureError: it cannot, because of the machine.
    """
    if commands.refused:
        raise RefusedError(commands.error)
    if commands.error:
        kind = InfrastructureError if commands.infrastructure else StackFaultError
        raise kind(f"stack: {commands.error}")


@dataclass(slots=True)
class _Partial:
    """A seq whose messages are still arriving."""

    tick: Tick | None = None
    episodes: dict[int, Episode] = field(default_factory=dict)
    sensors: dict[str, tuple[Frame, bytes]] = field(default_factory=dict)

    def complete(self) -> bool:
        return (
            self.tick is not None
            and set(self.tick.sensors) <= set(self.sensors)
            and self.tick.episodes == len(self.episodes)
        )


class StackEnd:
    """The stack's end: gathers a seq, hands it out once, answers repeats from the cache."""

    def __init__(self, bus: Bus, rig: str, slots: int) -> None:
        self._bus = bus
        self._rig = rig
        self._slots = slots
        self._inbox: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self._partial: dict[int, _Partial] = {}
        self._handed = -1
        self._answer: tuple[int, bytes] = (-1, b"")
        self._map: Any = None
        self._gpu = ""
        """GPU whose memory both sides see; empty: none."""
        self._opened: dict[bytes, DeviceMemory] = {}
        self._gone = False
        self.takes_device_frames = False
        """The stack takes large arrays in a GPU's memory; set before the first :meth:`receive`."""
        self.reads: frozenset[str] | None = None
        """As the simulator's; set before the first :meth:`receive`."""
        self.repeated = 0
        """Seqs answered from the cache."""
        self.dropped = 0
        """Messages that came while too many were waiting."""
        # Each counted by one thread: what arrived, and what was looked at [bytes].
        self._arrived, self._read = 0, 0
        bus.subscribe(topics.READY.key.format(rig=rig, side="simulator"), self._keep)
        bus.subscribe(topics.EPISODE.key.format(rig=rig), self._keep)
        bus.subscribe(topics.TICK.key.format(rig=rig), self._keep)
        bus.subscribe(topics.sensor_key(rig, "*"), self._keep)
        bus.watch(topics.SIMULATOR_ALIVE.key.format(rig=rig), self._on_alive)

    def _keep(self, sample: Sample) -> None:
        """Keep a message of the simulator: one that repeats itself to a stack that thinks for long
        must not fill its memory."""
        size = len(sample.payload) + len(sample.attachment)
        waiting = self._arrived - self._read
        too_many = self._inbox.qsize() >= STACK_WAITING_MAX
        if too_many or (waiting and waiting + size > STACK_WAITING_BYTES_MAX):
            self.dropped += 1
            return
        self._arrived += size
        self._inbox.put(sample)

    def _on_alive(self, _key: str, alive: bool) -> None:
        self._gone = not alive

    def receive(self, on_wait: Callable[[], None]) -> Incoming:
        """The next seq, complete; ``on_wait`` runs while waiting and may raise."""
        while True:
            try:
                sample = self._inbox.get(timeout=READY_PERIOD_S)
            except queue.Empty:
                on_wait()
                if self._gone:
                    raise InfrastructureError("the simulator went away") from None
                if self._handed < 0:
                    self._say_ready(seen=False)
                continue
            self._read += len(sample.payload) + len(sample.attachment)
            seq = self._take(sample)
            if seq is None:
                continue
            partial = self._partial[seq]
            if partial.complete():
                self._handed = seq
                # Older seqs are settled: the simulator never goes back.
                self._partial = {s: p for s, p in self._partial.items() if s > seq}
                return self._incoming(partial)

    def answer(self, commands: Commands) -> None:
        """Answer the seq handed out last."""
        data = encode(commands)
        self._answer = (commands.seq, data)
        self._bus.publish(topics.COMMAND.key.format(rig=self._rig), data, block=True)

    def refuse(self, reason: str) -> None:
        """Say that the stack is not the one that was submitted, until the simulator is gone: the
        worker must hear of it before it sees the end of this process."""
        until_s = time.monotonic() + REFUSE_S
        seq = self._handed
        while not self._gone and time.monotonic() < until_s:
            if seq < 0:
                self._say_ready(seen=False, refused=reason)
            else:
                self.answer(Commands(SCHEMA_VERSION, seq, [], error=reason, refused=True))
            with contextlib.suppress(queue.Empty):
                self._inbox.get(timeout=READY_PERIOD_S)

    def _take(self, sample: Sample) -> int | None:
        """File one message; the seq it belongs to, or None if there is nothing to hand out."""
        if sample.key.endswith("/control/simulator"):
            offer: Ready = decode(sample.payload, Ready)
            if offer.slots != self._slots or offer.rig != self._rig:
                raise InfrastructureError(
                    f"simulator offers rig {offer.rig} with {offer.slots} slots, "
                    f"this stack was started for {self._rig} with {self._slots}"
                )
            self._open(offer)
            if not offer.seen:
                self._say_ready(seen=True)
            return None
        name = sample.key.rsplit("/", 1)[1]
        if name == "tick":
            tick: Tick = decode(sample.payload, Tick)
            seq = tick.seq
            if seq <= self._handed:
                if seq == self._answer[0]:
                    self.repeated += 1
                    key = topics.COMMAND.key.format(rig=self._rig)
                    self._bus.publish(key, self._answer[1], block=True)
                return None
            self._part(seq).tick = tick
            return seq
        if name == "episode":
            episode: Episode = decode(sample.payload, Episode)
            if episode.seq <= self._handed:
                return None
            episodes = self._part(episode.seq).episodes
            if len(episodes) >= PARTS_MAX and episode.slot not in episodes:
                raise WireError(f"more than {PARTS_MAX} episodes in a seq")
            episodes[episode.slot] = episode
            return episode.seq
        frame: Frame = decode(sample.attachment, Frame, ATTACHMENT_BYTES_MAX)
        if frame.seq <= self._handed:
            return None
        sensors = self._part(frame.seq).sensors
        if len(sensors) >= PARTS_MAX and name not in sensors:
            raise WireError(f"more than {PARTS_MAX} sensor messages in a seq")
        sensors[name] = (frame, sample.payload)
        return frame.seq

    def _part(self, seq: int) -> _Partial:
        """Messages of ``seq`` that have arrived."""
        if seq not in self._partial and len(self._partial) >= SEQS_MAX:
            raise WireError(f"parts of more than {SEQS_MAX} seqs; finish one before the next")
        return self._partial.setdefault(seq, _Partial())

    def _open(self, offer: Ready) -> None:
        """Try what is offered; what does not work here is done without."""
        if offer.frames and self._map is None:
            self._map = open_frames(offer.frames, offer.frames_bytes, offer.nonce)
        if offer.gpu and self.takes_device_frames and not self._gpu:
            from twin.base.gpu import cuda

            if cuda.proves(offer.gpu_handle, offer.gpu_nonce, offer.gpu):
                self._gpu = offer.gpu

    def _incoming(self, partial: _Partial) -> Incoming:
        assert partial.tick is not None
        sensors = {}
        counts = {}
        for name in partial.tick.sensors:
            frame, payload = partial.sensors[name]
            sensors[name] = self._array(frame, payload)
            if frame.count:
                counts[name] = np.array(frame.count, np.int32)
        episodes = [partial.episodes[slot] for slot in sorted(partial.episodes)]
        return Incoming(partial.tick, episodes, sensors, counts)

    def _on_device(self, frame: Frame) -> DeviceFrame:
        if not self._gpu:
            raise WireError("frame lies in a GPU's memory that this side did not open")
        memory = self._opened.get(frame.handle)
        if memory is None:
            from twin.base.gpu import cuda

            if len(self._opened) >= DEVICES_MAX:
                raise WireError(f"more than {DEVICES_MAX} arrays in GPU memory")
            try:
                memory = cuda.DeviceMemory(frame.handle, frame.dtype, frame.shape, self._gpu)
            except Exception as error:  # whatever Warp raises for a handle it cannot open
                raise InfrastructureError(f"{self._gpu}: {error}") from None
            self._opened[frame.handle] = memory
        if memory.shape != tuple(frame.shape) or memory.dtype != _dtype(frame):
            raise WireError(f"array of {frame.shape} behind the handle of one of {memory.shape}")
        return memory.frame()

    def _array(self, frame: Frame, payload: bytes) -> NDArray[Any] | DeviceFrame:
        if frame.handle:
            return self._on_device(frame)
        dtype = _dtype(frame)
        count = math.prod(frame.shape)
        size = count * dtype.itemsize
        if frame.offset >= 0 and size > 0:
            if self._map is None or HEADER_BYTES + frame.offset + size > len(self._map):
                raise WireError("frame lies outside the shared buffer")
            start = HEADER_BYTES + frame.offset
            return np.frombuffer(self._map, dtype, count, start).reshape(frame.shape)
        if not 0 < size <= FRAME_BYTES_MAX:
            raise WireError(f"array of {size} bytes, at most {FRAME_BYTES_MAX} are accepted")
        if len(payload) != size:
            raise WireError(f"array of {len(payload)} bytes, its shape says {size}")
        return np.frombuffer(payload, dtype, count).reshape(frame.shape)

    def _say_ready(self, *, seen: bool, refused: str = "") -> None:
        ready = Ready(
            v=SCHEMA_VERSION,
            role="stack",
            rig=self._rig,
            slots=self._slots,
            shared=self._map is not None,
            on_gpu=bool(self._gpu),
            seen=seen,
            minor=DRIVE_MINOR,
            refused=refused,
            reads=None if self.reads is None else sorted(self.reads),
        )
        self._bus.publish(topics.READY.key.format(rig=self._rig, side="stack"), encode(ready))


def _dtype(frame: Frame) -> np.dtype[Any]:
    """Type of a frame's array, its shape checked; NumPy's own parser takes whole programs."""
    if frame.dtype not in DTYPES:
        raise WireError(f"array of {frame.dtype}, allowed: {', '.join(DTYPES)}")
    if len(frame.shape) > AXES_MAX or min(frame.shape, default=0) < 0:
        raise WireError(f"array of shape {frame.shape[: AXES_MAX + 1]}, at most {AXES_MAX} axes")
    return np.dtype(frame.dtype)
