"""A node of ours in a domain of ROS 2, and the router at which the domain's other nodes meet.

All that comes in (messages, requests, tokens) waits in one queue, in the order of arrival: a node
that has left is known to have left after its last message, never before.
"""

from __future__ import annotations

import queue
import resource
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import xxhash
import zenoh
import zenoh.ext

from twin.base.errors import InfrastructureError, StackFaultError
from twin.fabric.ros2.attachment import Attachment, AttachmentError, parse_attachment
from twin.fabric.ros2.graph import TopicType
from twin.fabric.ros2.names import (
    Endpoint,
    EndpointQos,
    Entity,
    RosNode,
    endpoint_token,
    node_token,
    topic_key,
    watched_tokens,
)
from twin.fabric.ros2.place import MeetingPlace
from twin.fabric.zenoh_bus import open_session, session_config

MESSAGE_BYTES_MAX = 1 << 20
"""Largest message to the bridge [bytes]; commands are below 10 kB."""

WAITING_MAX = 10_000
"""Most messages, requests and tokens that wait to be looked at; more is a flood."""

WAITING_BYTES_MAX = 64 << 20
"""Most bytes of them; more is a flood, too."""

LINK_BYTES_MAX = 64 << 20
"""Largest message between any two nodes that the router puts together [bytes]."""


POOL_BYTES_MAX = 32 << 20
"""Most shared memory for messages to nodes; a message that does not fit takes the network
[bytes]."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message on a topic that is subscribed to."""

    topic: str
    payload: bytes
    attachment: Attachment


@dataclass(frozen=True, slots=True)
class ServiceCall:
    """A call of a service of ours."""

    service: str
    payload: bytes
    respond: Callable[[bytes, int], None]
    """Answers it, once: payload, and a time [ns]."""


@dataclass(frozen=True, slots=True)
class Token:
    """An entity has come or gone."""

    token: str
    alive: bool


@dataclass(frozen=True, slots=True)
class Refused:
    """Something came that no node of these releases sends; one line."""

    reason: str


Arrived = Message | ServiceCall | Token | Refused
"""What waits in the queue."""


class Ros2Session:
    """A node of ours, as long as it lives."""

    def __init__(self, session: zenoh.Session, endpoint: str, domain: int, name: str) -> None:
        """Be there; see :meth:`listening` and :meth:`joined`.

        Args:
            session: of Zenoh; ours from now on.
            endpoint: where it listens; empty: nowhere.
            domain: number of the ROS 2 domain.
            name: of our node.
        """
        self._domain, self._session, self.endpoint = domain, session, endpoint
        self._inbox: queue.Queue[Arrived] = queue.Queue(WAITING_MAX)
        self._waiting_bytes, self.flooded = 0, False
        self._node = RosNode(str(session.info.zid()), 0, name)
        self._entities = 0
        self._closed = False
        self._lock = threading.Lock()
        self._kept: list[Any] = []
        self._announce(node_token(domain, self._node))
        self._kept.append(
            session.liveliness().declare_subscriber(
                watched_tokens(domain),
                zenoh.handlers.Callback(self._on_token, indirect=False),
                history=True,
            )
        )

    @classmethod
    def listening(cls, place: MeetingPlace, domain: int, name: str) -> Ros2Session:
        """A node that is its domain's router, too.

        Raises:
            InfrastructureError: the endpoint cannot be listened at.
        """
        config = session_config(
            "router",
            listen=[place.listen],
            key=place.key,
            shared_memory=place.shared_memory,
            message_bytes_max=LINK_BYTES_MAX,
        )
        if place.shared_memory:
            path = "transport/shared_memory/transport_optimization/pool_size"
            config.insert_json5(path, str(_pool_bytes()))
        # Nodes that are peers hear of each other from their router, as they do from rmw_zenoh's.
        config.insert_json5("scouting/gossip/enabled", "true")
        try:
            session, (endpoint,) = open_session(config, [place.listen])
        except zenoh.ZError as error:
            reason = " ".join(str(error).split(" at /")[0].split())
            raise InfrastructureError(f"{place.listen}: cannot listen: {reason}") from None
        return cls(session, endpoint, domain, name)

    @classmethod
    def joined(cls, variables: Mapping[str, str], name: str) -> Ros2Session:
        """A node as rmw_zenoh opens one, from its environment
        (:meth:`twin.fabric.ros2.place.MeetingPlace.variables`).

        Raises:
            InfrastructureError: its router does not answer.
        """
        config = session_config("client", protocols=("tcp", "tls"))
        for option in variables["ZENOH_CONFIG_OVERRIDE"].split(";"):
            path, _, value = option.partition("=")
            config.insert_json5(path, value)
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            reason = " ".join(str(error).split(" at /")[0].split())
            raise InfrastructureError(f"no router of ROS 2 answers: {reason}") from None
        return cls(session, "", int(variables["ROS_DOMAIN_ID"]), name)

    @property
    def id(self) -> str:
        """Zenoh's identifier of this session, hexadecimal."""
        return self._node.session

    def publish(self, topic: str, what: TopicType, qos: EndpointQos) -> Publisher:
        """Declare a publisher.

        Raises:
            NameMistakeError: ROS 2 allows no such topic.
        """
        key = topic_key(self._domain, topic, what.type, what.type_hash)
        options: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.BLOCK}
        if qos.transient_local:
            publisher: Any = zenoh.ext.declare_advanced_publisher(
                *(self._session, key),
                **options,
                cache=zenoh.ext.CacheConfig(max_samples=max(qos.depth, 1)),
                publisher_detection=True,
            )
        else:
            publisher = self._session.declare_publisher(key, **options)
        token = self._endpoint(Entity.publisher, topic, what, qos)
        return Publisher(publisher, gid_of(token))

    def subscribe(self, topic: str, what: TopicType, qos: EndpointQos) -> None:
        """Have messages of a topic put into the queue.

        Raises:
            NameMistakeError: ROS 2 allows no such topic.
        """

        def receive(sample: zenoh.Sample) -> None:
            self._put(_message(topic, sample))

        key = topic_key(self._domain, topic, what.type, what.type_hash)
        self._kept.append(
            self._session.declare_subscriber(key, zenoh.handlers.Callback(receive, indirect=False))
        )
        self._endpoint(Entity.subscription, topic, what, qos)

    def serve(self, service: str, what: TopicType) -> None:
        """Have requests to a service put into the queue.

        Raises:
            NameMistakeError: ROS 2 allows no such service.
        """
        key = topic_key(self._domain, service, what.type, what.type_hash)

        def receive(query: zenoh.Query) -> None:
            self._put(_request(service, key, query))

        self._kept.append(
            self._session.declare_queryable(
                key, zenoh.handlers.Callback(receive, indirect=False), complete=True
            )
        )
        self._endpoint(Entity.service, service, what, EndpointQos())

    def receive(self, timeout_s: float) -> Arrived | None:
        """What came next, or None after ``timeout_s``.

        Raises:
            StackFaultError: nodes sent more than anybody can look at.
        """
        try:
            arrived = (
                self._inbox.get(timeout=timeout_s) if timeout_s > 0 else self._inbox.get_nowait()
            )
        except queue.Empty:
            return self._checked(None)
        with self._lock:
            self._waiting_bytes -= _size(arrived)
        return self._checked(arrived)

    def close(self) -> None:
        """Leave the domain."""
        with self._lock:
            closed, self._closed = self._closed, True
        if not closed:
            self._kept.clear()
            self._session.close()  # type: ignore[no-untyped-call]

    def _checked(self, arrived: Arrived | None) -> Arrived | None:
        if self.flooded:
            raise StackFaultError(
                f"ros2: more than {WAITING_MAX} messages or {WAITING_BYTES_MAX} bytes of nodes wait"
            )
        return arrived

    def _put(self, arrived: Arrived) -> None:
        size = _size(arrived)
        with self._lock:
            if self._waiting_bytes + size > WAITING_BYTES_MAX or self._inbox.full():
                self.flooded = True
                return
            self._waiting_bytes += size
            self._inbox.put_nowait(arrived)  # nobody else puts

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._put(Token(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

    def _endpoint(self, kind: Entity, topic: str, what: TopicType, qos: EndpointQos) -> str:
        self._entities += 1
        endpoint = Endpoint(self._node, self._entities, kind, topic, what.type, what.type_hash, qos)
        token = endpoint_token(self._domain, endpoint)
        self._announce(token)
        return token

    def _announce(self, token: str) -> None:
        self._kept.append(self._session.liveliness().declare_token(token))


class Publisher:
    """A publisher of our node; numbers its messages from 1."""

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self._publisher, self._gid = publisher, gid
        self._sequence = 0

    def put(self, payload: bytes | bytearray, stamp_ns: int) -> None:
        """Send one message, with a time [ns]; waits where a node is slow."""
        self._sequence += 1
        attachment = Attachment(self._sequence, stamp_ns, self._gid)
        self._publisher.put(payload, attachment=attachment.encoded())


def _size(arrived: Arrived) -> int:
    """Bytes that it holds, all but small change."""
    if isinstance(arrived, Message | ServiceCall):
        return len(arrived.payload)
    return len(arrived.token) if isinstance(arrived, Token) else len(arrived.reason)


def _pool_bytes() -> int:
    """Shared memory that may be had: Zenoh locks it, and a larger one would not be used at all."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit == resource.RLIM_INFINITY:
        return POOL_BYTES_MAX
    return max(1 << 20, min(POOL_BYTES_MAX, limit - (2 << 20)))


def gid_of(token: str) -> bytes:
    """Identifier of an entity: XXH3 of its token, 128 bits, the low half first."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def _message(topic: str, sample: zenoh.Sample) -> Arrived:
    size = len(sample.payload)
    if size > MESSAGE_BYTES_MAX:
        return Refused(f"a message of {size} bytes on {topic}, allowed: {MESSAGE_BYTES_MAX}")
    try:
        attachment = parse_attachment(_bytes(sample.attachment))
    except AttachmentError as error:
        return Refused(f"a message on {topic} is not of these releases of rmw_zenoh: {error}")
    return Message(topic, sample.payload.to_bytes(), attachment)


def _request(service: str, key: str, query: zenoh.Query) -> Arrived:
    size = 0 if query.payload is None else len(query.payload)
    if size > MESSAGE_BYTES_MAX:
        return Refused(f"a request of {size} bytes to {service}, allowed: {MESSAGE_BYTES_MAX}")
    payload = _bytes(query.payload)
    try:
        attachment = parse_attachment(_bytes(query.attachment))
    except AttachmentError as error:
        return Refused(f"a request to {service} is not of these releases of rmw_zenoh: {error}")

    def respond(answer: bytes, stamp_ns: int) -> None:
        back = Attachment(attachment.sequence, stamp_ns, attachment.gid)
        try:
            query.reply(key, answer, attachment=back.encoded())
            query.drop()  # type: ignore[no-untyped-call]
        except zenoh.ZError:
            pass  # who asked is gone

    return ServiceCall(service, payload, respond)


def _bytes(data: Any) -> bytes:
    """Bytes of a payload or attachment; of one that is far too large, none."""
    if data is None or len(data) > MESSAGE_BYTES_MAX:
        return b""
    return bytes(data.to_bytes())
