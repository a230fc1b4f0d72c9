"""Key expressions and liveliness tokens of rmw_zenoh. Pure.

The source is rmw_zenoh's design page (``docs/design.md`` of ros2/rmw_zenoh, which says that its
table of keys is what others have to follow) and, for the fields of a quality of service, the
comments of its ``liveliness_utils.hpp``. The formats of Jazzy, Kilted and Rolling differ in what
:data:`RELEASES` says; Humble has no type hashes and cannot speak with any of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

ADMIN = "@ros2_lv"
"""First part of every token; Zenoh's ``**`` does not match it."""

NO_HASH = "TypeHashNotSupported"
"""What stands in place of a type hash in ROS 2 Humble."""

TOKEN_CHARS_MAX = 2048
"""Longest token that is looked at; a longer one is counted and left out."""

DEPTH_DEFAULT = 42
"""Depth that a token leaves out; rmw_zenoh's own where a node names none."""

PARTS_NODE, PARTS_ENDPOINT = 9, 13
"""Parts of the token of a node, and of that of an endpoint."""

_NAME = re.compile(r"/?[A-Za-z_~][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z")
_TYPE = re.compile(r"([A-Za-z][A-Za-z0-9_]*)/(msg|srv)/([A-Za-z][A-Za-z0-9_]*)\Z")
_DDS_TYPE = re.compile(r"([A-Za-z][A-Za-z0-9_]*)::(msg|srv)::dds_::([A-Za-z][A-Za-z0-9_]*)_\Z")
_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")
_ID = re.compile(r"[0-9a-f]{1,32}\Z")
_PRINTABLE = re.compile(r"[ -~]*\Z")


class NameMistakeError(ValueError):
    """A name, type or token that ROS 2 does not allow; one line."""


class Entity(StrEnum):
    """What a token stands for."""

    node = "NN"
    publisher = "MP"
    subscription = "MS"
    service = "SS"
    client = "SC"


@dataclass(frozen=True, slots=True)
class KeyFormat:
    """What a release of ROS 2 puts on the wire, as far as releases differ."""

    name: str
    backends: bool
    """Whether a token may end in a further part, which names kinds of memory that the endpoint
    takes besides plain bytes (rmw_zenoh 0.10.5). Peers that know none get plain bytes."""


RELEASES = {
    "jazzy": KeyFormat("jazzy", backends=False),
    "kilted": KeyFormat("kilted", backends=False),
    "rolling": KeyFormat("rolling", backends=True),
}
"""Releases by name; Lyrical is as Rolling."""


@dataclass(frozen=True, slots=True)
class EndpointQos:
    """Quality of service, as far as it matters here; numbers are those of ``rmw/types.h``."""

    reliable: bool = True
    """Else best effort."""
    transient_local: bool = False
    """Late subscriptions get the last messages; else volatile."""
    depth: int = 10
    """Messages that are kept; 0: all of them."""

    def encoded(self) -> str:
        """The last part of a token: fields that differ from rmw_zenoh's default, in its order."""
        reliability = "" if self.reliable else "2"
        durability = "1" if self.transient_local else ""
        kept = "" if self.depth == DEPTH_DEFAULT else str(self.depth)
        history = f",{kept}" if self.depth else "2,"
        return f"{reliability}:{durability}:{history}:,:,:,,"


def parse_qos(text: str) -> EndpointQos:
    """What :meth:`EndpointQos.encoded` wrote, or a real node.

    Raises:
        NameMistakeError: it is none.
    """
    fields = text.split(":")
    if len(fields) != 6 or not re.fullmatch(r"[0-9,]*", "".join(fields)):
        raise NameMistakeError(f"no quality of service: {_shown(text)}")
    kind, _, depth = fields[2].partition(",")
    return EndpointQos(
        reliable=fields[0] != "2",
        transient_local=fields[1] == "1",
        depth=0 if kind == "2" else int(depth[:9] or DEPTH_DEFAULT),
    )


@dataclass(frozen=True, slots=True)
class RosNode:
    """A node of the graph."""

    session: str
    """Zenoh's identifier of its session, hexadecimal."""
    number: int
    """Counts the nodes of a session."""
    name: str
    namespace: str = "/"
    enclave: str = "/"

    @property
    def full_name(self) -> str:
        """Namespace and name, as ROS 2's tools print them."""
        return f"{self.namespace.rstrip('/')}/{self.name}"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher, subscription, service or client."""

    node: RosNode
    number: int
    """Counts the entities of a session."""
    kind: Entity
    topic: str
    """Full name of the topic or service, with its leading slash."""
    type: str
    """``sensor_msgs/msg/Image``."""
    type_hash: str
    """``RIHS01_`` and 64 hexadecimal digits, or :data:`NO_HASH`."""
    qos: EndpointQos = EndpointQos()
    backends: str = ""
    """Kinds of memory that it takes, if it names any (:attr:`KeyFormat.backends`)."""


def check_name(name: str) -> str:
    """A topic's, service's or node's full name, with its leading slash.

    Raises:
        NameMistakeError: ROS 2 allows no such name.
    """
    if len(name) > 255 or not _NAME.match(name) or "__" in name or "~" in name:
        raise NameMistakeError(
            f"given the name {_shown(name)}, allowed: letters, digits and single underscores, "
            "separated by slashes"
        )
    return name if name.startswith("/") else f"/{name}"


def dds_type(name: str) -> str:
    """``sensor_msgs::msg::dds_::Image_`` of ``sensor_msgs/msg/Image``.

    Raises:
        NameMistakeError: it is no type's name.
    """
    match = _TYPE.match(name)
    if match is None:
        raise NameMistakeError(f"given the type {_shown(name)}, expected package/msg/Name")
    return f"{match[1]}::{match[2]}::dds_::{match[3]}_"


def ros_type(name: str) -> str:
    """The inverse of :func:`dds_type`.

    Raises:
        NameMistakeError: it is no type's name.
    """
    match = _DDS_TYPE.match(name)
    if match is None:
        raise NameMistakeError(f"no type's name: {_shown(name)}")
    return f"{match[1]}/{match[2]}/{match[3]}"


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Key expression of a topic or service: ``<domain>/<name>/<type>/<hash>``.

    Raises:
        NameMistakeError: a part is not what ROS 2 allows.
    """
    if not _HASH.match(type_hash):
        raise NameMistakeError(
            f"given the type hash {_shown(type_hash)}, expected RIHS01_ and 64 digits"
        )
    return f"{check_domain(domain)}/{check_name(topic)[1:]}/{dds_type(type_name)}/{type_hash}"


def check_domain(domain: int) -> int:
    """A domain's number.

    Raises:
        NameMistakeError: there is no such domain (ROS 2 has 0 to 232).
    """
    if not 0 <= domain <= 232:
        raise NameMistakeError(f"given domain {domain}, allowed: 0 to 232")
    return domain


def watched_tokens(domain: int) -> str:
    """Key expression that all tokens of a domain match."""
    return f"{ADMIN}/{check_domain(domain)}/**"


def node_token(domain: int, node: RosNode) -> str:
    """Token of a node."""
    return _token(domain, node, node.number, Entity.node)


def endpoint_token(domain: int, endpoint: Endpoint) -> str:
    """Token of an endpoint.

    Raises:
        NameMistakeError: its type has no such name.
    """
    head = _token(domain, endpoint.node, endpoint.number, endpoint.kind)
    parts = (
        *(_mangled(endpoint.topic), dds_type(endpoint.type), endpoint.type_hash),
        *(endpoint.qos.encoded(), *([endpoint.backends] if endpoint.backends else [])),
    )
    return "/".join((head, *parts))


def parse_token(token: str) -> RosNode | Endpoint:
    """What a token of any release says; its last parts may be more than we know.

    Raises:
        NameMistakeError: it is no token of rmw_zenoh; one line.
    """
    if len(token) > TOKEN_CHARS_MAX or not _PRINTABLE.match(token):
        raise NameMistakeError(f"a token of {len(token)} characters or unprintable ones")
    parts = token.split("/")
    if len(parts) < PARTS_NODE or parts[0] != ADMIN or not all(parts):
        raise NameMistakeError(f"no token of a node: {_shown(token)}")
    _, domain, session, node_number, number, kind_word, enclave, namespace, name = parts[
        :PARTS_NODE
    ]
    numbers = (domain, node_number, number)
    if not all(word.isascii() and word.isdecimal() and len(word) < 10 for word in numbers):
        raise NameMistakeError(f"no token of a node: {_shown(token)}")
    if not _ID.match(session):
        raise NameMistakeError(f"no token of a session: {_shown(token)}")
    node = RosNode(session, int(node_number), name, _demangled(namespace), _demangled(enclave))
    try:
        kind = Entity(kind_word)
    except ValueError:
        raise NameMistakeError(f"a token of an unknown kind: {_shown(kind_word)}") from None
    if kind is Entity.node:
        return node
    if len(parts) < PARTS_ENDPOINT:
        raise NameMistakeError(f"a token without topic, type, hash and quality: {_shown(token)}")
    topic, type_name, type_hash, qos = parts[PARTS_NODE:PARTS_ENDPOINT]
    if type_hash != NO_HASH and not _HASH.match(type_hash):
        raise NameMistakeError(f"no type hash: {_shown(type_hash)}")
    return Endpoint(
        *(node, int(number), kind, check_name(_demangled(topic)), ros_type(type_name)),
        *(type_hash, parse_qos(qos), "/".join(parts[PARTS_ENDPOINT:])),
    )


def _token(domain: int, node: RosNode, number: int, kind: Entity) -> str:
    parts = (
        *(ADMIN, str(check_domain(domain)), node.session, str(node.number), str(number)),
        *(kind.value, _mangled(node.enclave), _mangled(node.namespace), node.name),
    )
    return "/".join(parts)


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _demangled(name: str) -> str:
    return name.replace("%", "/")


def _shown(text: str) -> str:
    """Text of a stranger, printable and short."""
    return repr(text[:80]) + ("..." if len(text) > 80 else "")
