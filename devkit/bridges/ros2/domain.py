"""A domain of ROS 2 as the bridge has it: its topics, the nodes that are there, what they say."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable

from schemas.escape import escape
from twin.fabric.ros2.graph import Graph, TopicType
from twin.fabric.ros2.names import RELEASES, EndpointQos, Entity, KeyFormat
from twin.fabric.ros2.place import MeetingPlace
from twin.fabric.ros2.session import Message, Publisher, Refused, Ros2Session, ServiceCall, Token
from twin.ros2.sending import TopicMessage
from twin.ros2.store import TypeStore
from twin.ros2.tables import Qos, TopicTable

NODE = "drivetwin"
"""Name of our node."""

CLOCK = "/clock"

STEP = "/drivetwin/step"
"""Service that answers ticks where stamps do not."""

STEP_TYPE = "std_srvs/srv/Trigger"

TYPES_OF = {"jazzy": "jazzy", "kilted": "kilted", "rolling": "lyrical"}
"""Distribution of the types by name of the release of keys."""


class RosDomain:
    """Our node in the domain, from its start to its end."""

    def __init__(
        self, place: MeetingPlace, table: TopicTable, store: TypeStore, domain: int, release: str
    ) -> None:
        """Listen, and declare what is known before a case is.

        Args:
            place: where.
            table: topics.
            store: types of the release.
            domain: number of the ROS 2 domain.
            release: one of :data:`twin.fabric.ros2.names.RELEASES`.

        Raises:
            InfrastructureError: the endpoint cannot be listened at.
        """
        self._store, self._table = store, table
        self.session = Ros2Session.listening(place, domain, NODE)
        self._publishers: dict[str, Publisher] = {}
        expected = {row.topic: self._expected(row.type) for row in table.commands}
        expected[STEP] = self._expected(STEP_TYPE)
        self.graph = Graph(self.session.id, _release(release), expected)
        for row in table.commands:
            self.session.subscribe(row.topic, expected[row.topic], _qos(row.qos))
        self.session.serve(STEP, expected[STEP])

    @property
    def endpoint(self) -> str:
        """Where nodes connect."""
        return self.session.endpoint

    def send(self, messages: Iterable[TopicMessage]) -> None:
        """Publish a tick's messages, in order but for ``/clock``, which comes last."""
        last = []
        for each in messages:
            if each.topic == CLOCK:
                last.append(each)
            else:
                self._put(each)
        for each in last:
            self._put(each)

    def receive(self, timeout_s: float) -> Message | ServiceCall | Refused | Token | None:
        """What came next; tokens are in :attr:`graph` already, and what they mean was told.

        Raises:
            StackFaultError: a flood.
        """
        arrived = self.session.receive(timeout_s)
        if isinstance(arrived, Token):
            self.graph.change(arrived.token, arrived.alive)
            self.tell(self.graph.take_lines())
        return arrived

    def answer(self, request: ServiceCall, stamp_ns: int, why_not: str) -> None:
        """Answer a call of the service of steps; ``why_not`` says why it moved nothing."""
        success = not why_not
        response = self._store.make(f"{STEP_TYPE}_Response", success=success, message=why_not)
        request.respond(self._store.encode(response), stamp_ns)

    def commanders(self, topic: str) -> list[str]:
        """Full names of the nodes that publish a command as we have it."""
        return [each.node.full_name for each in self.graph.endpoints(topic, Entity.publisher)]

    def unheard_commanders(self, topic: str) -> list[str]:
        """Why commands of nodes that publish on a topic do not arrive, a line each."""
        return self.graph.unheard(topic, Entity.publisher)

    def is_heard(self, topic: str) -> bool:
        """Whether somebody subscribes to a topic, of whatever type."""
        return bool(self.graph.named(topic, Entity.subscription))

    def is_stepped(self) -> bool:
        """Whether there is a client of the service of steps."""
        return bool(self.graph.endpoints(STEP, Entity.client))

    def tell(self, lines: Iterable[str]) -> None:
        """Write lines into the rig's log."""
        for line in lines:
            print(f"ros2: {escape(line)}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the domain."""
        with contextlib.suppress(OSError):
            self.session.close()

    def _put(self, each: TopicMessage) -> None:
        publisher = self._publishers.get(each.topic)
        if publisher is None:
            what = self._expected(each.type_name)
            self.graph.expect(each.topic, what)
            self.tell(self.graph.take_lines())
            publisher = self.session.publish(each.topic, what, _qos(each.qos))
            self._publishers[each.topic] = publisher
        publisher.put(self._store.encode(each.message), each.time_ns)

    def _expected(self, type_name: str) -> TopicType:
        return TopicType(type_name, self._store.type_hash(type_name))


def _qos(qos: Qos) -> EndpointQos:
    return EndpointQos(
        reliable=qos.reliability == "reliable",
        transient_local=qos.durability == "transient_local",
        depth=qos.depth,
    )


def _release(name: str) -> KeyFormat:
    return RELEASES[name]
