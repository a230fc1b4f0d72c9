"""A real session of ours and a real Zenoh session of somebody else, on loopback."""

from __future__ import annotations

import json
import os
import queue
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
import zenoh.ext
from waiting import PATIENCE_S, wait_for

from twin.base.errors import InfrastructureError, StackFaultError, UsageError
from twin.fabric.ros2.attachment import Attachment
from twin.fabric.ros2.graph import TopicType
from twin.fabric.ros2.names import EndpointQos, Entity, parse_token, topic_key
from twin.fabric.ros2.place import FILES, SETTINGS, MeetingPlace
from twin.fabric.ros2.session import (
    MESSAGE_BYTES_MAX,
    WAITING_BYTES_MAX,
    WAITING_MAX,
    Message,
    Refused,
    Ros2Session,
    ServiceCall,
    Token,
    gid_of,
)

STRING = TopicType(
    "std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
TRIGGER = TopicType("std_srvs/srv/Trigger", "RIHS01_" + "5" * 64)
KEY = topic_key(0, "/chatter", STRING.type, STRING.type_hash)
GID = bytes(range(16))
GOOD = Attachment(1, 2, GID).encoded()


def settings(variables: dict[str, str]) -> dict[str, Any]:
    parts = variables["ZENOH_CONFIG_OVERRIDE"].split(";")
    return {path: json.loads(value) for path, _, value in (part.partition("=") for part in parts)}


def joined(options: dict[str, Any]) -> zenoh.Session:
    """A session as rmw_zenoh opens it: what is said to it is put over its own settings."""
    config = zenoh.Config()
    for path, value in {"mode": "peer", "scouting/multicast/enabled": False, **options}.items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


@pytest.fixture
def place() -> Iterator[MeetingPlace]:
    made = MeetingPlace("rig", own_network=False)
    yield made
    made.close()


@pytest.fixture
def ours(place: MeetingPlace) -> Iterator[Ros2Session]:
    session = Ros2Session.listening(place, 0, "drivetwin")
    yield session
    session.close()


@pytest.fixture
def theirs(place: MeetingPlace, ours: Ros2Session) -> Iterator[zenoh.Session]:
    with joined(settings(place.variables(ours.endpoint, 0))) as session:
        yield session


def until(ours: Ros2Session, wanted: Callable[[Any], bool]) -> Any:
    while True:
        arrived = ours.receive(PATIENCE_S)
        assert arrived is not None, "nothing came"
        if wanted(arrived):
            return arrived


def is_a(kind: type) -> Callable[[Any], bool]:
    return lambda arrived: isinstance(arrived, kind)


def test_messages_pass_both_ways(ours, theirs):
    ours.subscribe("/chatter", STRING, EndpointQos())
    out = ours.publish("/back", STRING, EndpointQos())
    inbox: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    back = topic_key(0, "/back", STRING.type, STRING.type_hash)
    theirs.declare_subscriber(back, inbox.put)
    theirs.put(KEY, b"hello", attachment=GOOD)
    assert until(ours, is_a(Message)) == Message("/chatter", b"hello", Attachment(1, 2, GID))
    out.put(b"one", 5)
    out.put(b"two", 6)
    first, second = inbox.get(timeout=PATIENCE_S), inbox.get(timeout=PATIENCE_S)
    assert (first.payload.to_bytes(), second.payload.to_bytes()) == (b"one", b"two")
    tokens = [
        parse_token(str(reply.ok.key_expr)) for reply in theirs.liveliness().get("@ros2_lv/0/**")
    ]
    publisher = next(each for each in tokens if getattr(each, "kind", "") == Entity.publisher)
    assert publisher.topic == "/back"
    gid = next(
        gid_of(str(reply.ok.key_expr))
        for reply in theirs.liveliness().get("@ros2_lv/0/*/*/*/MP/**")
    )
    assert first.attachment.to_bytes() == Attachment(1, 5, gid).encoded()
    assert second.attachment.to_bytes() == Attachment(2, 6, gid).encoded()


def test_a_node_of_ours_joins_as_a_stranger_does(place, ours):
    ours.subscribe("/chatter", STRING, EndpointQos())
    node = Ros2Session.joined(place.variables(ours.endpoint, 0), "node")
    node.publish("/chatter", STRING, EndpointQos()).put(b"hello", 3)
    message = until(ours, is_a(Message))
    assert (message.payload, message.attachment.sequence) == (b"hello", 1)
    node.close()
    with pytest.raises(InfrastructureError, match="no router of ROS 2 answers"):
        Ros2Session.joined(place.variables("tls/127.0.0.1:1", 0), "node")


def test_a_late_subscription_gets_what_is_kept_for_it(ours, theirs):
    """Durability transient_local, as an AdvancedSubscriber asks for it: rmw_zenoh's way."""
    out = ours.publish("/episode", STRING, EndpointQos(transient_local=True, depth=1))
    out.put(b"old", 1)
    out.put(b"new", 2)
    inbox: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    key = topic_key(0, "/episode", STRING.type, STRING.type_hash)
    zenoh.ext.declare_advanced_subscriber(
        *(theirs, key, inbox.put),
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
    )
    assert inbox.get(timeout=PATIENCE_S).payload.to_bytes() == b"new"


def test_a_service_is_called_and_answers_with_the_callers_number(ours, theirs):
    ours.serve("/step", TRIGGER)
    until(ours, lambda arrived: isinstance(arrived, Token) and "/SS/" in arrived.token)
    key = topic_key(0, "/step", TRIGGER.type, TRIGGER.type_hash)
    inbox: queue.SimpleQueue[zenoh.Reply] = queue.SimpleQueue()
    theirs.get(
        key, inbox.put, payload=b"ask", attachment=GOOD, target=zenoh.QueryTarget.ALL_COMPLETE
    )
    call = until(ours, is_a(ServiceCall))
    assert (call.service, call.payload) == ("/step", b"ask")
    call.respond(b"answer", 77)
    reply = inbox.get(timeout=PATIENCE_S)
    assert reply.ok.payload.to_bytes() == b"answer"
    assert reply.ok.attachment.to_bytes() == Attachment(1, 77, GID).encoded()


def test_who_leaves_is_known_after_its_last_message(place, ours):
    ours.subscribe("/chatter", STRING, EndpointQos())
    node = joined(settings(place.variables(ours.endpoint, 0)))
    token = f"@ros2_lv/0/{node.info.zid()}/0/0/NN/%/%/node"
    kept = node.liveliness().declare_token(token)
    node.put(KEY, b"last", attachment=GOOD)
    until(ours, lambda arrived: isinstance(arrived, Token) and arrived.token == token)
    node.close()
    del kept
    came = []
    until(ours, lambda arrived: came.append(arrived) or arrived == Token(token, False))
    assert Message("/chatter", b"last", Attachment(1, 2, GID)) in came


@pytest.mark.parametrize(
    ("payload", "attachment", "reason"),
    [
        (bytes(MESSAGE_BYTES_MAX + 1), GOOD, f"a message of {MESSAGE_BYTES_MAX + 1} bytes"),
        (b"x", None, "its attachment has 0 bytes"),
        (b"x", b"\x0fsequence_number", "rmw_zenoh before 0.2.4"),
        (b"x", bytes(MESSAGE_BYTES_MAX + 1), "its attachment has 0 bytes"),
    ],
)
def test_what_no_node_sends_is_told(ours, theirs, payload, attachment, reason):
    ours.subscribe("/chatter", STRING, EndpointQos())
    theirs.put(KEY, payload, attachment=attachment)
    assert reason in until(ours, is_a(Refused)).reason


def test_a_flood_ends_it(ours, theirs):
    ours.subscribe("/chatter", STRING, EndpointQos())

    def flood() -> None:
        """Two come for one that is looked at."""
        while True:
            for _ in range(2):
                theirs.put(
                    KEY, b"x", attachment=GOOD, congestion_control=zenoh.CongestionControl.BLOCK
                )
            assert ours.receive(PATIENCE_S) is not None

    with pytest.raises(StackFaultError, match=f"more than {WAITING_MAX} messages"):
        flood()


def test_a_flood_of_bytes_ends_it_too(ours, theirs):
    """Far fewer messages than may wait, each as large as may be."""
    ours.subscribe("/chatter", STRING, EndpointQos())
    large = bytes(MESSAGE_BYTES_MAX)
    for _ in range(WAITING_BYTES_MAX // MESSAGE_BYTES_MAX):
        theirs.put(KEY, large, attachment=GOOD, congestion_control=zenoh.CongestionControl.BLOCK)
        until(ours, is_a(Message))  # what was looked at does not wait
    for _ in range(WAITING_BYTES_MAX // MESSAGE_BYTES_MAX + 1):
        theirs.put(KEY, large, attachment=GOOD, congestion_control=zenoh.CongestionControl.BLOCK)
    wait_for(lambda: ours.flooded, "the flood")
    with pytest.raises(StackFaultError, match=f"or {WAITING_BYTES_MAX} bytes of nodes wait"):
        ours.receive(0.0)


def test_nobody_without_the_rigs_key_hears_or_says_anything(place, ours):
    """Loopback belongs to every user of the host: another one connects, and gets no session."""
    options = settings(place.variables(ours.endpoint, 0))
    other = MeetingPlace("rig", own_network=False)
    try:
        wrong = settings(other.variables(ours.endpoint, 0))
        bare = {"mode": "client", "connect/endpoints": options["connect/endpoints"]}
        plain = {**bare, "connect/endpoints": [ours.endpoint.replace("tls/", "tcp/")]}
        for stranger in (wrong, bare, plain):
            with pytest.raises(zenoh.ZError):
                joined({**stranger, "mode": "client", "connect/timeout_ms": 500}).close()
    finally:
        other.close()
    # Its own node listens nowhere, where others might come instead.
    assert options["mode"] == "client"


def test_keys_of_nodes_are_files_of_this_process_alone(place):
    options = settings(place.variables("tls/127.0.0.1:1", 0))
    for name in FILES:
        path = Path(options[f"transport/link/tls/{name}"])
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert path.read_bytes().startswith(b"-----BEGIN")
        assert str(os.getpid()) in str(path)
    place.close()
    assert not path.exists()


def test_keys_for_nodes_that_somebody_else_starts_lie_in_a_folder_while_it_is_open(tmp_path):
    folder = tmp_path / "ros2" / "autoware"
    place = MeetingPlace("rig", own_network=False, folder=folder, port=7555)
    assert place.listen == "tls/127.0.0.1:7555"
    variables = place.variables("tls/127.0.0.1:7555", 7)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    for name in (*FILES.values(), SETTINGS):
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o600
    text = (folder / SETTINGS).read_text()
    assert "export ROS_DOMAIN_ID=7\n" in text
    assert f"export ZENOH_CONFIG_OVERRIDE='{variables['ZENOH_CONFIG_OVERRIDE']}'" in text
    place.close()
    assert list(folder.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"parameters\.keys: .*; give a folder of your own"):
        MeetingPlace("rig", own_network=False, folder=tmp_path / "file" / "below")


def test_a_network_of_ones_own_needs_no_key(tmp_path):
    place = MeetingPlace("rig", own_network=True)
    assert place.listen == "tcp/127.0.0.1:7447"
    assert place.key is None
    assert settings(place.variables(place.listen, 0)) == {"connect/endpoints": [place.listen]}
    shared = MeetingPlace("rig", own_network=True, shared_memory=True)
    assert settings(shared.variables(place.listen, 0))["transport/shared_memory/enabled"] is True


def test_a_port_that_is_taken_is_one_line(ours):
    port = int(ours.endpoint.rpartition(":")[2])
    place = MeetingPlace("rig", own_network=False, port=port)
    try:
        with pytest.raises(InfrastructureError, match=f"tls/127.0.0.1:{port}: cannot listen"):
            Ros2Session.listening(place, 0, "drivetwin")
    finally:
        place.close()
