"""The bridge and a node of ours on real sessions: what a node does at the wrong time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
from ros2_messages import car_tick, episode
from waiting import PATIENCE_S, wait_for

from devkit.bridges.ros2 import Ros2Bridge
from devkit.bridges.ros2.domain import STEP, STEP_TYPE
from devkit.stack import Observation
from schemas.messages import Command
from twin.base.errors import InfrastructureError, StackFaultError
from twin.fabric.ros2.attachment import Attachment
from twin.fabric.ros2.graph import TopicType
from twin.fabric.ros2.names import EndpointQos, topic_key
from twin.fabric.ros2.session import Message, Publisher, Ros2Session, ServiceCall, Token
from twin.ros2.parts import MessageParts
from twin.ros2.store import type_store

STORE = type_store()
TABLE = """
table: drive
sensors: [{topic: /clock, source: clock}, {topic: "/picture/{name}", source: camera}]
commands: [{topic: /drive, type: ackermann_msgs/msg/AckermannDriveStamped}]
"""
CLOCK = "rosgraph_msgs/msg/Clock"
DRIVE = "ackermann_msgs/msg/AckermannDriveStamped"
TICK_NS = 50_000_000


class Rig:
    """The bridge, waiting for nodes that somebody else starts."""

    def __init__(self, folder: Any, **parameters: Any) -> None:
        table = folder / "table.yaml"
        table.write_text(TABLE)
        self.bridge = Ros2Bridge(1, **{"table": str(table), "keys": "test", **parameters})
        self.bridge.attach(None)
        self.nodes: list[Ros2Session] = []

    def node(self) -> Ros2Session:
        """A node that joins by the rig's key."""
        domain, place = self.bridge.domain, self.bridge._place
        assert domain is not None
        assert place is not None
        self.nodes.append(Ros2Session.joined(place.variables(domain.endpoint, 0), "node"))
        return self.nodes[-1]

    def close(self) -> None:
        for node in self.nodes:
            node.close()
        self.bridge.close()

    def inbox(self, kind: type) -> list[Any]:
        """What waits for the bridge."""
        assert self.bridge.domain is not None
        waiting = list(self.bridge.domain.session._inbox.queue)
        return [each for each in waiting if isinstance(each, kind)]

    def await_inbox(self, kind: type, count: int) -> None:
        """Until so many wait for the bridge."""
        wait_for(lambda: len(self.inbox(kind)) >= count, f"{count} of {kind.__name__}")


@pytest.fixture
def rigs(tmp_path, monkeypatch) -> Iterator[Any]:
    home = tmp_path / "home"
    home.mkdir(mode=0o700)
    monkeypatch.setenv("DRIVETWIN_HOME", str(home))
    made: list[Rig] = []

    def rig(**parameters: Any) -> Rig:
        made.append(Rig(tmp_path, **parameters))
        return made[-1]

    yield rig
    for each in made:
        each.close()


def driving(node: Ros2Session, type_name: str = DRIVE) -> Publisher:
    what = TopicType(type_name, STORE.type_hash(type_name))
    return node.publish("/drive", what, EndpointQos())


def asked(stamp_ns: int, speed_mps: float) -> bytes:
    """Bytes of a command."""
    parts = MessageParts(STORE)
    drive = STORE.make(
        "ackermann_msgs/msg/AckermannDrive",
        steering_angle=0.0,
        steering_angle_velocity=0.0,
        speed=speed_mps,
        acceleration=0.0,
        jerk=0.0,
    )
    return STORE.encode(STORE.make(DRIVE, header=parts.header(stamp_ns, "base_link"), drive=drive))


def observed(tick: int) -> Observation:
    """What the car saw at a tick, standing."""
    return Observation(
        seq=tick,
        active=np.array([True]),
        token=np.array([7], np.int64),
        tick=np.array([tick], np.int32),
        sim_time_ns=np.array([TICK_NS * tick], np.int64),
        sensors={"vehicle": np.zeros((1, 7))},
        counts={},
    )


def hear_clock(node: Ros2Session) -> None:
    """Let a node hear what time it is."""
    node.subscribe("/clock", TopicType(CLOCK, STORE.type_hash(CLOCK)), EndpointQos())


def clock_ns(node: Ros2Session) -> int | None:
    """The time that a node is told next; None: nothing came."""
    arrived = node.receive(0.05)
    if arrived is None or not hasattr(arrived, "topic"):
        return None
    clock = STORE.decode(CLOCK, arrived.payload).clock
    return int(clock.sec * 10**9 + clock.nanosec)


class Answering:
    """A node that answers every /clock with a speed, until it is stopped."""

    def __init__(self, node: Ros2Session, publisher: Publisher, speed_mps: float) -> None:
        self._node, self._publisher, self._speed_mps = node, publisher, speed_mps
        hear_clock(node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            stamp_ns = clock_ns(self._node)
            if stamp_ns is not None:
                self._publisher.put(asked(stamp_ns, self._speed_mps), 0)

    def end(self) -> None:
        self._ended.set()
        self._thread.join()


def test_a_node_that_never_stops_talking_does_not_hold_the_deadline_up(rigs):
    rig = rigs(answer_s=0.5)
    node = rig.node()
    publisher = driving(node)
    hear_clock(node)
    rig.bridge.reset(0, episode())
    ended = threading.Event()

    def talk() -> None:
        """Commands of a tick that is over, once the next one has begun."""
        while not ended.is_set() and (clock_ns(node) or 0) < 3 * TICK_NS:
            pass
        while not ended.is_set():
            publisher.put(asked(0, 1.0), 0)
            ended.wait(0.001)

    talker = threading.Thread(target=talk)
    talker.start()
    try:
        with pytest.raises(InfrastructureError, match=r"that of tick 3, within 0\.5 s"):
            rig.bridge.step(observed(3))
    finally:
        ended.set()
        talker.join()


def test_what_the_last_case_left_does_not_reach_the_next(rigs):
    """Commands with its stamps, before the next case's first tick and after it."""
    rig = rigs(answer_s=PATIENCE_S)
    node = rig.node()
    publisher = driving(node)
    answering = Answering(node, publisher, 5.0)
    try:
        rig.bridge.reset(0, episode())
        (command,) = rig.bridge.step(observed(100))
        assert command.throttle > 0.5
        for number in range(3):
            publisher.put(asked(101 * TICK_NS, 9.0), number)
        rig.await_inbox(Message, 3)
        rig.bridge.reset(0, episode())
        assert not rig.inbox(Message)
        publisher.put(asked(102 * TICK_NS, 9.0), 0)
        rig.await_inbox(Message, 1)
        (command,) = rig.bridge.step(observed(0))
        assert (command.tick, rig.bridge.lockstep.late) == (0, 1)
    finally:
        answering.end()


def test_a_node_that_has_left_may_come_again_for_the_next_case(rigs):
    rig = rigs(start_s=PATIENCE_S)
    first = rig.node()
    driving(first)
    rig.bridge.reset(0, episode())
    first.close()
    domain = rig.bridge.domain
    assert domain is not None
    wait_for(
        lambda: any("/MP/" in each.token and not each.alive for each in rig.inbox(Token)),
        "the end of its publisher",
    )
    driving(rig.node())
    rig.bridge.reset(0, episode())
    assert domain.commanders("/drive") == ["/node"]
    assert rig.bridge.left == ""


def calls(rig: Rig, node: Ros2Session, count: int) -> list[Any]:
    """Call the service of steps, without waiting for its answers; they come into the list."""
    key = topic_key(0, STEP, STEP_TYPE, STORE.type_hash(STEP_TYPE))
    replies: list[Any] = []
    for number in range(count):
        attachment = Attachment(number + 1, 0, bytes(16)).encoded()
        node._session.get(key, replies.append, payload=b"\0\1\0\0\0", attachment=attachment)
    return replies


def said(replies: list[Any], count: int) -> list[tuple[bool, str]]:
    wait_for(lambda: len(replies) >= count, "answers")
    found = [
        STORE.decode(f"{STEP_TYPE}_Response", reply.ok.payload.to_bytes()) for reply in replies
    ]
    return [(each.success, each.message) for each in found]


def test_a_call_before_the_tick_answers_nothing(rigs, monkeypatch):
    """Those that wait when a case or a tick begins cannot have seen it."""
    rig = rigs(answer="step")
    monkeypatch.setattr(rig.bridge, "_unheard", list)  # who calls here has no token
    node = rig.node()
    publisher = driving(node)
    early = calls(rig, node, 1)
    rig.await_inbox(ServiceCall, 1)
    rig.bridge.reset(0, episode())
    assert said(early, 1) == [(False, "no tick waits")]
    publisher.put(asked(0, 5.0), 0)
    unseen = calls(rig, node, 2)
    rig.await_inbox(ServiceCall, 2)
    rig.await_inbox(Message, 1)
    results: list[list[Command]] = []
    stepping = threading.Thread(target=lambda: results.append(rig.bridge.step(observed(0))))
    stepping.start()
    assert said(unseen, 2) == [(False, "no tick waits")] * 2
    wait_for(lambda: rig.bridge.lockstep.stamp_ns == 0, "the tick")
    assert not results
    seen = calls(rig, node, 1)
    stepping.join()
    assert said(seen, 1) == [(True, "")]
    assert results[0][0].throttle > 0.5, "the command that came before is in force"


def test_a_publisher_of_another_type_is_told_at_once(rigs):
    rig = rigs(start_s=3600.0)
    driving(rig.node(), "geometry_msgs/msg/Twist")
    with pytest.raises(StackFaultError, match="node /node publishes /drive as geometry_msgs"):
        rig.bridge.reset(0, episode())


def test_a_table_that_does_not_fit_the_case_is_the_stacks_fault(rigs):
    rig = rigs()
    driving(rig.node())
    case = episode()
    case.cameras[0] = msgspec.structs.replace(case.cameras[0], name="front-left")
    with pytest.raises(StackFaultError, match="front-left makes the topic /picture/front-left"):
        rig.bridge.reset(0, case)
    rig.bridge.table = shared(rig.bridge.table)
    with pytest.raises(StackFaultError, match="/picture would carry front, rear"):
        rig.bridge.reset(0, episode())


def shared(table: Any) -> Any:
    rows = [
        msgspec.structs.replace(row, topic="/picture") if row.source == "camera" else row
        for row in table.sensors
    ]
    return msgspec.structs.replace(table, sensors=rows)


def test_a_flood_between_cases_is_no_cases_fault(rigs):
    rig = rigs()
    publisher = driving(rig.node())
    rig.bridge.reset(0, episode())
    assert rig.bridge.domain is not None
    session = rig.bridge.domain.session
    padding = bytes(1 << 20)
    for _ in range(80):
        publisher.put(padding, 0)
    wait_for(lambda: session.flooded, "the flood")
    with pytest.raises(InfrastructureError, match="bytes of nodes wait") as found:
        rig.bridge.reset(0, episode())
    assert not isinstance(found.value, StackFaultError)


def test_a_flood_within_a_case_is_the_stacks_fault(rigs):
    rig = rigs()
    publisher = driving(rig.node())
    rig.bridge.reset(0, episode())
    assert rig.bridge.domain is not None
    session = rig.bridge.domain.session
    for _ in range(80):
        publisher.put(bytes(1 << 20), 0)
    wait_for(lambda: session.flooded, "the flood")
    with pytest.raises(StackFaultError, match="bytes of nodes wait"):
        rig.bridge.step(observed(car_tick().tick))
