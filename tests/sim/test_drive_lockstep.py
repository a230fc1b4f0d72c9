"""The lockstep exchange survives loss, delay and duplication, and never steps a stack twice."""

import threading
from types import SimpleNamespace
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from schemas import SCHEMA_VERSION
from schemas.messages import Command, Commands, Episode, Frame, Ready, Tick
from schemas.sections.perception import GroundTruthPerception
from schemas.wire.codec import MESSAGE_BYTES_MAX, encode
from twin.base.errors import InfrastructureError, RefusedError, StackFaultError
from twin.base.gpu import cuda
from twin.fabric.drive import (
    WAITING_BYTES_MAX,
    WAITING_MAX,
    Outgoing,
    SimulatorEnd,
    StackEnd,
)
from twin.fabric.frames import FrameBuffer, FrameChannel
from twin.fabric.memory_bus import Faults, MemoryHub
from twin.fabric.rig_folder import RigFolder, frames_socket

SLOTS = 3
SHAPE = (SLOTS, 4, 6, 3)


def image(seq):
    return np.full(SHAPE, seq % 251, np.uint8)


def frame(seq, offset):
    return Frame(
        v=SCHEMA_VERSION,
        type="camera",
        seq=seq,
        active=[True] * SLOTS,
        case=["c"] * SLOTS,
        token=[1, 2, 3],
        tick=[seq] * SLOTS,
        sim_time_ns=[seq] * SLOTS,
        dtype="|u1",
        shape=list(SHAPE),
        encoding="rgb8",
        offset=offset,
    )


def tick(seq, episodes):
    return Tick(
        v=SCHEMA_VERSION,
        seq=seq,
        active=[True] * SLOTS,
        token=[1, 2, 3],
        tick=[seq] * SLOTS,
        sim_time_ns=[seq] * SLOTS,
        sensors=["camera"],
        episodes=episodes,
    )


def episode(seq):
    return Episode(
        v=SCHEMA_VERSION,
        seq=seq,
        slot=seq % SLOTS,
        token=1,
        case="c",
        seed=1,
        model="m",
        perception=GroundTruthPerception(),
        camera="front_right",
        width=6,
        height=4,
        hfov_deg=70.0,
        control_period_ns=50_000_000,
    )


def run_stack(link, count, stepped):
    while len(stepped) < count:
        incoming = link.receive(lambda: None)
        seq = incoming.tick.seq
        stepped.append((seq, len(incoming.episodes), int(incoming.sensors["camera"][1, 2, 3, 0])))
        commands = [Command(slot, slot + 1, seq, 0.5, 0.0, 0.0) for slot in range(SLOTS)]
        link.answer(Commands(v=SCHEMA_VERSION, seq=seq, commands=commands))


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_every_seq_is_stepped_once_and_in_order(seed, shared):
    count = 25
    hub = MemoryHub(seed=seed, faults=Faults(loss=0.1, duplicate=0.2, delay=0.2))
    hub.run()
    folder = RigFolder()
    door = frames_socket(folder.drive)
    frames = FrameBuffer(int(np.prod(SHAPE)), door) if shared else None
    buffer = frames.array(FrameChannel("camera", SHAPE, "|u1"), 0) if frames else None
    stepped = []
    stack = StackEnd(hub.open(), "r", SLOTS)
    simulator = SimulatorEnd(hub.open(), "r", SLOTS, frames, resend_s=0.02)
    # A daemon that may still wait for repeats when the test is over.
    threading.Thread(target=run_stack, args=(stack, count + 10**9, stepped), daemon=True).start()
    simulator.handshake(lambda: None)
    assert simulator.transport == ("memory" if shared else "bytes")
    for seq in range(count):
        if buffer is not None:
            buffer[:] = image(seq)
        payload = b"" if shared else image(seq).tobytes()
        starts = [episode(seq)] if seq % 5 == 0 else []
        outgoing = [Outgoing("camera", frame(seq, 0 if shared else -1), payload)]
        commands = simulator.exchange(seq, tick(seq, len(starts)), outgoing, starts, lambda: None)
        assert commands.seq == seq
        assert [c.tick for c in commands.commands] == [seq] * SLOTS
    hub.stop()
    assert stepped == [(seq, int(seq % 5 == 0), seq % 251) for seq in range(count)]
    counters = hub.counters
    assert counters.lost > 0, f"seed {seed} drove no loss"
    assert counters.duplicated > 0, f"seed {seed} drove no duplicate"
    assert counters.delayed > 0, f"seed {seed} drove no delay"
    if frames:
        frames.close()
    folder.close()


class OtherMemory:
    """Stands for a GPU's memory, which is not here: arrays known by handle in this process."""

    arrays: ClassVar[dict[bytes, np.ndarray]] = {}
    opened: ClassVar[list[bytes]] = []

    def __init__(self, handle, dtype, shape, device):
        assert device == "cuda:0"
        self.opened.append(handle)
        self._array = self.arrays[handle]
        self.shape, self.dtype = tuple(shape), np.dtype(dtype)

    def frame(self):
        return SimpleNamespace(shape=self.shape, dtype=self.dtype, host=lambda: self._array)


@pytest.mark.parametrize("takes", [True, False])
def test_frames_in_shared_gpu_memory(monkeypatch, takes):
    """The protocol alone; ``tests/device/campaign_check.py`` does it with a GPU."""
    nonce = np.zeros(64, np.uint8)
    nonce[:4] = np.frombuffer(b"abcd", np.uint8)
    OtherMemory.arrays = {b"probe": nonce, b"picture": image(0)}
    OtherMemory.opened = []
    monkeypatch.setattr(cuda, "DeviceMemory", OtherMemory)
    hub = MemoryHub(seed=1)
    hub.run()
    folder = RigFolder()
    frames = FrameBuffer(int(np.prod(SHAPE)), frames_socket(folder.drive))
    probe = SimpleNamespace(handle=b"probe", nonce="abcd")
    stack = StackEnd(hub.open(), "r", SLOTS)
    stack.takes_device_frames = takes
    simulator = SimulatorEnd(
        hub.open(), "r", SLOTS, frames, probe=probe, device="cuda:0", resend_s=0.02
    )
    seen = []

    def serve():
        while True:
            incoming = stack.receive(lambda: None)
            camera = incoming.sensors["camera"]
            seen.append(int((camera.host() if takes else camera)[1, 2, 3, 0]))
            stack.answer(Commands(v=SCHEMA_VERSION, seq=incoming.tick.seq, commands=[]))

    threading.Thread(target=serve, daemon=True).start()
    simulator.handshake(lambda: None)
    assert simulator.transport == ("device" if takes else "memory")
    buffer = frames.array(FrameChannel("camera", SHAPE, "|u1"), 0)
    for seq in range(4):
        buffer[:] = OtherMemory.arrays[b"picture"][:] = image(7 * seq)
        sent = msgspec.structs.replace(
            frame(seq, -1 if takes else 0), handle=b"picture" if takes else b""
        )
        simulator.exchange(seq, tick(seq, 0), [Outgoing("camera", sent, b"")], [], lambda: None)
    hub.stop()
    assert seen == [0, 7, 14, 21]
    expected = [b"probe", b"picture"] if takes else []
    assert OtherMemory.opened == expected, "once each, and only where it is of use"
    frames.close()
    folder.close()


def held():
    """A simulator's end, and a stack that says what a test wants."""
    hub = MemoryHub(seed=1)
    return hub, SimulatorEnd(hub.open(), "r", SLOTS, None, resend_s=0.02), hub.open()


def answer_to(seq):
    return encode(Commands(v=SCHEMA_VERSION, seq=seq, commands=[]))


def test_a_stack_that_only_says_what_nobody_asked_for_does_not_hide_the_time():
    """``on_wait`` ends the exchange, though there is always another message."""
    hub, simulator, stack = held()
    hub.run()
    stop = threading.Event()
    ready = encode(Ready(v=SCHEMA_VERSION, role="stack", rig="r", slots=SLOTS))

    def talk():
        while not stop.wait(0.005):  # seldom enough to be no flood
            stack.publish("drive/r/control/stack", ready)

    def give_up():
        raise TimeoutError

    talker = threading.Thread(target=talk, daemon=True)
    talker.start()
    try:
        with pytest.raises(TimeoutError):
            simulator.exchange(7, tick(7, 0), [], [], give_up)
    finally:
        stop.set()
        talker.join()
        hub.stop()


@pytest.mark.parametrize(("said", "times"), [(8, 1), (6, 12)])
def test_an_answer_that_was_not_asked_for_names_both_seqs(said, times):
    """One from the future at once, one from the past when it comes too often to be late."""
    hub, simulator, stack = held()
    for _ in range(times):
        stack.publish("drive/r/command", answer_to(said))
    stack.publish("drive/r/command", answer_to(7))
    hub.deliver()
    with pytest.raises(StackFaultError, match=f"answers seq {said}, asked for 7"):
        simulator.exchange(7, tick(7, 0), [], [], lambda: None)


def test_late_answers_are_let_pass():
    hub, simulator, stack = held()
    for seq in range(3):
        for late in range(seq + 1):
            stack.publish("drive/r/command", answer_to(late))
        hub.deliver()
        assert simulator.exchange(seq, tick(seq, 0), [], [], lambda: None).seq == seq


def test_while_nothing_is_asked_every_answer_is_late():
    """In real time, between two messages; -1 is what a stack may begin with."""
    hub, simulator, stack = held()
    for seq in (-1, 0, 7):
        stack.publish("drive/r/command", answer_to(seq))
    hub.deliver()
    assert simulator.answered(None, 0.0) is None
    stack.publish("drive/r/command", answer_to(8))
    hub.deliver()
    assert simulator.answered(8, 0.0).seq == 8


def test_many_readies_are_no_flood():
    """A stack says that it is ready every 50 ms while a first frame is drawn."""
    hub, simulator, stack = held()
    ready = Ready(v=SCHEMA_VERSION, role="stack", rig="r", slots=SLOTS)
    for _ in range(WAITING_MAX + 1):
        stack.publish("drive/r/control/stack", encode(ready))
    stack.publish("drive/r/command", answer_to(7))
    hub.deliver()
    assert simulator.exchange(7, tick(7, 0), [], [], lambda: None).seq == 7


@pytest.mark.parametrize("key", ["command", "control/stack"])
def test_messages_that_wait_have_a_size(key):
    hub, simulator, stack = held()
    count = WAITING_BYTES_MAX // MESSAGE_BYTES_MAX + 2
    payload = bytes(MESSAGE_BYTES_MAX + (key != "command"))
    for _ in range(count):
        stack.publish(f"drive/r/{key}", payload)
    hub.deliver()
    said = f"more than {WAITING_BYTES_MAX} bytes wait" if key == "command" else "message of"
    with pytest.raises(InfrastructureError, match=said):
        simulator.exchange(7, tick(7, 0), [], [], lambda: None)
    with pytest.raises(InfrastructureError, match=said):
        simulator.handshake(lambda: None)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("at", ["handshake", "exchange"])
def test_a_stack_that_is_not_the_submitted_one_says_so_until_it_is_heard(seed, at):
    hub = MemoryHub(seed=seed, faults=Faults(loss=0.3, duplicate=0.2, delay=0.2))
    hub.run()
    stack = StackEnd(hub.open(), "r", SLOTS)
    bus = hub.open()
    simulator = SimulatorEnd(bus, "r", SLOTS, None, resend_s=0.02)

    def refuse():
        if at == "exchange":
            stack.receive(lambda: None)
        stack.refuse("mine.py has changed")

    refusing = threading.Thread(target=refuse, daemon=True)
    refusing.start()

    def meet():
        simulator.handshake(lambda: None)
        simulator.exchange(0, tick(0, 0), [outgoing(0)], [], lambda: None)

    with pytest.raises(RefusedError, match=r"^mine\.py has changed$"):
        meet()
    bus.close()  # only now does it end
    refusing.join(timeout=50)
    hub.stop()
    assert not refusing.is_alive()


def outgoing(seq):
    return Outgoing("camera", frame(seq, -1), image(seq).tobytes())


@pytest.mark.parametrize("reads", [None, frozenset(), frozenset(["camera", "lidar.roof"])])
@pytest.mark.parametrize("seed", range(3))
def test_the_simulator_knows_what_the_stack_looks_at(seed, reads):
    hub = MemoryHub(seed=seed, faults=Faults(loss=0.3, duplicate=0.2, delay=0.2))
    hub.run()
    stack = StackEnd(hub.open(), "r", SLOTS)
    stack.reads = reads
    simulator = SimulatorEnd(hub.open(), "r", SLOTS, None, resend_s=0.02)

    def serve():
        incoming = stack.receive(lambda: None)
        stack.answer(Commands(v=SCHEMA_VERSION, seq=incoming.tick.seq, commands=[]))

    threading.Thread(target=serve, daemon=True).start()
    simulator.handshake(lambda: None)
    hub.stop()
    assert simulator.reads == reads


def test_a_stack_that_looks_at_what_no_sensor_sends_is_told_so():
    hub, simulator, stack = held()
    hub.run()
    least = {"v": SCHEMA_VERSION, "role": "stack", "rig": "r", "slots": SLOTS, "seen": True}
    said = msgspec.msgpack.encode({**least, "reads": ["camera", "sonar"]})
    stack.publish("drive/r/control/stack", said)
    with pytest.raises(StackFaultError, match="stack: reads 'sonar'; allowed: messages of sensors"):
        simulator.handshake(lambda: None)
    hub.stop()
