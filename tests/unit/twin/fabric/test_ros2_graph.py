"""The graph of a domain knows who is there, and says why a message does not pass."""

from __future__ import annotations

import pytest

from twin.fabric.ros2.graph import ENTITIES_MAX, LINES_MAX, Graph, TopicType
from twin.fabric.ros2.names import (
    NO_HASH,
    RELEASES,
    Endpoint,
    Entity,
    RosNode,
    endpoint_token,
    node_token,
)

HASH = "RIHS01_" + "a" * 64
OTHER = "RIHS01_" + "b" * 64
DRIVE = TopicType("geometry_msgs/msg/TwistStamped", HASH)


def graph(release: str = "jazzy") -> Graph:
    return Graph("0123", RELEASES[release], {"/drive": DRIVE})


def token(
    name: str = "planner",
    kind: Entity = Entity.publisher,
    type_name: str = DRIVE.type,
    type_hash: str = HASH,
    session: str = "ab",
    number: int = 1,
    topic: str = "/drive",
    backends: str = "",
) -> str:
    node = RosNode(session, 0, name)
    endpoint = Endpoint(node, number, kind, topic, type_name, type_hash, backends=backends)
    return endpoint_token(0, endpoint)


def test_who_comes_and_goes_is_known():
    seen = graph()
    seen.change(node_token(0, RosNode("ab", 0, "planner")), True)
    seen.change(token(), True)
    seen.change(token(), True)  # told twice, as after a reconnection
    assert seen.nodes() == ["/planner"]
    (endpoint,) = seen.endpoints("/drive", Entity.publisher)
    assert endpoint.node.full_name == "/planner"
    assert seen.endpoints("/drive", Entity.subscription) == []
    seen.change(token(), False)
    assert seen.endpoints("/drive", Entity.publisher) == []
    seen.change(token(), False)
    assert seen.take_lines() == []


def test_our_own_tokens_do_not_count():
    seen = graph()
    seen.change(token(session="0123"), True)
    assert seen.named("/drive", Entity.publisher) == []


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (
            {"type_name": "geometry_msgs/msg/Twist"},
            "node /planner publishes /drive as geometry_msgs/msg/Twist, but it is "
            "geometry_msgs/msg/TwistStamped: no message passes",
        ),
        (
            {"type_hash": OTHER, "kind": Entity.subscription},
            "node /planner subscribes to /drive with another definition of "
            "geometry_msgs/msg/TwistStamped (RIHS01_bbbbbbbb..., here RIHS01_aaaaaaaa...): no "
            "message passes; its package is of another version",
        ),
        (
            {"type_hash": NO_HASH},
            "node /planner publishes /drive without a type hash, as ROS 2 Humble does: no message "
            "passes; it has to be Jazzy, Kilted, Rolling",
        ),
    ],
)
def test_what_does_not_pass_is_said_once(wrong, line):
    seen = graph()
    seen.change(token(**wrong), True)
    seen.change(token(**wrong), False)
    seen.change(token(**wrong), True)
    assert seen.take_lines() == [line]
    assert seen.take_lines() == []
    assert seen.mistakes("/drive") == [line]
    assert seen.endpoints("/drive", Entity.publisher) == []


def test_a_node_of_a_later_release_is_told_and_heard():
    line = (
        "node /planner is of ROS 2 Rolling or Lyrical, the campaign says jazzy; "
        "set rmw_zenoh: rolling"
    )
    seen = graph()
    seen.change(token(backends="backends:cpu"), True)
    assert seen.take_lines() == [line]
    assert len(seen.endpoints("/drive", Entity.publisher)) == 1
    rolling = graph("rolling")
    rolling.change(token(backends="backends:cpu"), True)
    assert rolling.take_lines() == []


def test_a_topic_that_is_known_later_is_looked_at_then():
    seen = graph()
    seen.change(token(topic="/camera", kind=Entity.subscription), True)
    assert seen.take_lines() == []
    seen.expect("/camera", TopicType("sensor_msgs/msg/Image", HASH))
    (line,) = seen.take_lines()
    assert "subscribes to /camera as geometry_msgs/msg/TwistStamped" in line


def test_a_flood_of_tokens_is_counted_and_told_once():
    seen = graph()
    for number in range(ENTITIES_MAX + 50):
        seen.change(token(number=number, topic="/x"), True)
    assert seen.left_out == 50
    (line,) = seen.take_lines()
    assert line.startswith(f"more than {ENTITIES_MAX} nodes and endpoints")
    for number in range(2 * LINES_MAX):
        seen.change(f"@ros2_lv/0/ab/{number}/0/nonsense{number}", True)
    assert len(seen.take_lines()) == LINES_MAX - 1
