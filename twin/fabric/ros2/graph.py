"""The graph of a domain: which nodes there are, and what they publish, subscribe to and serve.

Pure: a fold over tokens that come and go. It answers questions, and says in one line each what
would make a message silently not arrive: Zenoh compares keys, so a type or hash that differs is no
error anywhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.fabric.ros2.names import (
    NO_HASH,
    Endpoint,
    Entity,
    KeyFormat,
    NameMistakeError,
    RosNode,
    parse_token,
)

ENTITIES_MAX = 4096
"""Most tokens of strangers that are kept; Autoware has about 2,000 endpoints per hundred nodes."""

LINES_MAX = 200
"""Most lines that a graph says; further ones are counted."""


@dataclass(frozen=True, slots=True)
class TopicType:
    """A topic or service as the bridge has it."""

    type: str
    type_hash: str


class Graph:
    """Entities of other sessions by token, in order of arrival."""

    def __init__(self, own: str, release: KeyFormat, expected: Mapping[str, TopicType]) -> None:
        """Nothing is known yet.

        Args:
            own: identifier of our own session, whose tokens do not count.
            release: that the campaign names.
            expected: topics and services of the bridge by full name.
        """
        self._own, self._release, self._expected = own, release, dict(expected)
        self._entities: dict[str, RosNode | Endpoint] = {}
        self._said: set[str] = set()
        self._lines: list[str] = []
        self.left_out = 0
        """Tokens that were no tokens, or too many."""

    def change(self, token: str, alive: bool) -> None:
        """A token has come or gone."""
        if not alive:
            self._entities.pop(token, None)
            return
        try:
            entity = parse_token(token)
        except NameMistakeError as error:
            self.left_out += 1
            self._say(f"left out: {error}")
            return
        node = entity if isinstance(entity, RosNode) else entity.node
        if node.session == self._own or token in self._entities:
            return
        if len(self._entities) >= ENTITIES_MAX:
            self.left_out += 1
            self._say(f"more than {ENTITIES_MAX} nodes and endpoints; further ones are left out")
            return
        self._entities[token] = entity
        if isinstance(entity, Endpoint) and (mistake := self._mistake(entity)):
            self._say(mistake)

    def expect(self, topic: str, what: TopicType) -> None:
        """A topic or service of the bridge that was not known before."""
        self._expected[topic] = what
        for mistake in self.mistakes(topic):
            self._say(mistake)

    def named(self, topic: str, kind: Entity) -> list[Endpoint]:
        """Endpoints of this topic, whatever their type."""
        return [
            each
            for each in self._entities.values()
            if isinstance(each, Endpoint) and each.kind is kind and each.topic == topic
        ]

    def endpoints(self, topic: str, kind: Entity) -> list[Endpoint]:
        """Endpoints that messages reach: of this topic, with the type and hash that we have."""
        expected = self._expected[topic]
        return [
            each
            for each in self.named(topic, kind)
            if (each.type, each.type_hash) == (expected.type, expected.type_hash)
        ]

    def mistakes(self, topic: str) -> list[str]:
        """Why endpoints of this topic hear nothing, a line each."""
        kinds = (Entity.publisher, Entity.subscription, Entity.service, Entity.client)
        found = [self._mistake(each) for kind in kinds for each in self.named(topic, kind)]
        return list(dict.fromkeys(filter(None, found)))

    def unheard(self, topic: str, kind: Entity) -> list[str]:
        """Why messages of endpoints of this topic do not arrive, a line for each of those."""
        arriving = self.endpoints(topic, kind)
        return [self._mistake(each) for each in self.named(topic, kind) if each not in arriving]

    def nodes(self) -> list[str]:
        """Full names, sorted."""
        each = (e if isinstance(e, RosNode) else e.node for e in self._entities.values())
        return sorted({node.full_name for node in each})

    def take_lines(self) -> list[str]:
        """What is to be said since the last call; each line comes once."""
        lines, self._lines = self._lines, []
        return lines

    def _mistake(self, endpoint: Endpoint) -> str:
        """Why nothing passes between it and us, or nothing."""
        expected = self._expected.get(endpoint.topic)
        if expected is None:
            return ""
        who, what = f"node {endpoint.node.full_name}", _DOES[endpoint.kind]
        if endpoint.type != expected.type:
            return (
                f"{who} {what} {endpoint.topic} as {endpoint.type}, "
                f"but it is {expected.type}: no message passes"
            )
        if endpoint.type_hash == NO_HASH:
            return (
                f"{who} {what} {endpoint.topic} without a type hash, as ROS 2 Humble does: no "
                f"message passes; it has to be {', '.join(_NAMES)}"
            )
        if endpoint.type_hash != expected.type_hash:
            return (
                f"{who} {what} {endpoint.topic} with another definition of {expected.type} "
                f"({endpoint.type_hash[:15]}..., here {expected.type_hash[:15]}...): no message "
                "passes; its package is of another version"
            )
        if endpoint.backends and not self._release.backends:
            return (
                f"{who} is of ROS 2 Rolling or Lyrical, the campaign says {self._release.name}; "
                "set rmw_zenoh: rolling"
            )
        return ""

    def _say(self, line: str) -> None:
        if line not in self._said and len(self._said) < LINES_MAX:
            self._said.add(line)
            self._lines.append(line)


_NAMES = ("Jazzy", "Kilted", "Rolling")
_DOES = {
    Entity.publisher: "publishes",
    Entity.subscription: "subscribes to",
    Entity.service: "serves",
    Entity.client: "calls",
}
