"""Reading of junctions."""

from __future__ import annotations

from twin.road.opendrive.reading.node import Node
from twin.road.opendrive.records import Junction, JunctionConnection


def read_junction(node: Node, junction_id: str) -> Junction:
    """A ``junction`` element.

    Raises:
        ValueError: it cannot be used; one line with file, line and element.
    """
    kind = node.text("type", "default")
    if kind not in ("default", "direct"):
        node.refuse(f"type={kind[:40]!r}: only junctions of type default and direct are supported")
    connections: dict[str, JunctionConnection] = {}
    priorities = []
    for child in node.children(f"junction {junction_id[:40]}"):
        if child.name == "priority":
            priorities.append((child.text("high", ""), child.text("low", "")))
            continue
        connection = _connection(child, kind)
        if connection.id in connections:
            before = connections[connection.id].line
            child.refuse(f"id={connection.id[:40]!r} a second time, after line {before}")
        connections[connection.id] = connection
    return Junction(
        id=junction_id,
        name=node.text("name", ""),
        type="direct" if kind == "direct" else "default",
        connections=tuple(connections.values()),
        priorities=tuple(priorities),
        line=node.line,
    )


def _connection(node: Node, kind: str) -> JunctionConnection:
    contact = node.choice("contactPoint", ("start", "end"))
    return JunctionConnection(
        id=node.text("id"),
        incoming_road=node.text("incomingRoad"),
        connecting_road=node.text("linkedRoad" if kind == "direct" else "connectingRoad"),
        contact="start" if contact == "start" else "end",
        lane_links=tuple((link.whole("from"), link.whole("to")) for link in node.children()),
        line=node.line,
    )
