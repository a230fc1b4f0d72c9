"""Keys, tokens and attachments are those of rmw_zenoh's design page, byte for byte."""

from __future__ import annotations

import pytest
import zenoh.ext
from hypothesis import given
from hypothesis import strategies as st

from twin.fabric.ros2.attachment import Attachment, AttachmentError, parse_attachment
from twin.fabric.ros2.names import (
    NO_HASH,
    TOKEN_CHARS_MAX,
    Endpoint,
    EndpointQos,
    Entity,
    NameMistakeError,
    RosNode,
    check_name,
    dds_type,
    endpoint_token,
    node_token,
    parse_qos,
    parse_token,
    ros_type,
    topic_key,
    watched_tokens,
)

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ADD_TWO = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
LISTENER = (
    f"@ros2_lv/2/{SESSION}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/"
    f"{STRING}/::,10:,:,:,,"
)


def test_keys_are_those_of_the_design_page():
    """Its examples: a domain and a namespace are part of the key, slashes at the ends are not."""
    chatter = "std_msgs::msg::dds_::String_"
    assert (
        topic_key(0, "/chatter", "std_msgs/msg/String", STRING) == f"0/chatter/{chatter}/{STRING}"
    )
    key = topic_key(0, "/robot1/chatter", "std_msgs/msg/String", STRING)
    assert key == f"0/robot1/chatter/{chatter}/{STRING}"
    key = topic_key(2, "add_two_ints", "example_interfaces/srv/AddTwoInts", ADD_TWO)
    assert key == f"2/add_two_ints/example_interfaces::srv::dds_::AddTwoInts_/{ADD_TWO}"
    assert watched_tokens(2) == "@ros2_lv/2/**"


def test_tokens_are_those_of_the_design_page():
    node = RosNode(SESSION, 0, "listener")
    assert node_token(2, node) == f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener"
    qos = EndpointQos(depth=10)
    endpoint = Endpoint(
        node, 10, Entity.subscription, "/chatter", "std_msgs/msg/String", STRING, qos
    )
    assert endpoint_token(2, endpoint) == LISTENER
    assert parse_token(LISTENER) == endpoint
    assert parse_token(node_token(2, node)) == node
    inner = RosNode(SESSION, 3, "driver", "/sensing/lidar")
    token = node_token(2, inner)
    assert token == f"@ros2_lv/2/{SESSION}/3/3/NN/%/%sensing%lidar/driver"
    assert parse_token(token) == inner
    assert inner.full_name == "/sensing/lidar/driver"
    assert node.full_name == "/listener"


def test_a_token_of_rolling_may_name_kinds_of_memory():
    """A further part after the quality of service is read, and does not change the rest."""
    endpoint = parse_token(f"{LISTENER}/backends:cpu,cuda")
    assert isinstance(endpoint, Endpoint)
    assert endpoint.backends == "backends:cpu,cuda"
    assert endpoint.topic == "/chatter"
    assert endpoint_token(2, endpoint) == f"{LISTENER}/backends:cpu,cuda"


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (EndpointQos(depth=42), "::,:,:,:,,"),
        (EndpointQos(depth=7), "::,7:,:,:,,"),
        (EndpointQos(reliable=False, transient_local=True, depth=1), "2:1:,1:,:,:,,"),
        (EndpointQos(depth=0), "::2,:,:,:,,"),
    ],
)
def test_what_is_the_default_is_left_out(qos, text):
    assert qos.encoded() == text
    assert parse_qos(text) == qos


@pytest.mark.parametrize("text", ["", "::", "a:b:c:d:e:f", "::,1:,:,:,,:", "1;2"])
def test_a_quality_that_is_none_is_one_line(text):
    with pytest.raises(NameMistakeError, match="no quality of service"):
        parse_qos(text)


@pytest.mark.parametrize(
    ("token", "reason"),
    [
        ("", "no token of a node"),
        ("@ros2_lv/0/ab/0/0/NN/%/%", "no token of a node"),
        ("@ros2_lv//ab/0/0/NN/%/%/x", "no token of a node"),
        ("other/0/ab/0/0/NN/%/%/x", "no token of a node"),
        ("@ros2_lv/-1/ab/0/0/NN/%/%/x", "no token of a node"),
        ("@ros2_lv/0/ab/99999999999999999999/0/NN/%/%/x", "no token of a node"),
        ("@ros2_lv/0/XY/0/0/NN/%/%/x", "no token of a session"),
        ("@ros2_lv/0/ab/0/0/ZZ/%/%/x", "an unknown kind: 'ZZ'"),
        ("@ros2_lv/0/ab/0/1/MP/%/%/x", "without topic, type, hash and quality"),
        (LISTENER.replace(STRING, "RIHS01_short"), "no type hash: 'RIHS01_short'"),
        (LISTENER.replace("std_msgs::msg::dds_::String_", "String"), "no type's name: 'String'"),
        (LISTENER.replace("%chatter", "%chat*ter"), "given the name '/chat\\*ter'"),
        (LISTENER.replace("%chatter", "%x__y"), "given the name"),
        ("@ros2_lv/0/ab/0/0/NN/%/%/\x1b[2J", "unprintable"),
        ("@ros2_lv/0/ab/0/0/NN/%/%/" + "x" * TOKEN_CHARS_MAX, "a token of"),
    ],
)
def test_a_token_of_a_stranger_is_one_line(token, reason):
    with pytest.raises(NameMistakeError, match=reason) as found:
        parse_token(token)
    assert str(found.value).isprintable()
    assert len(str(found.value)) < 250


@given(st.text(max_size=300))
def test_no_text_is_more_than_a_mistake(text):
    for token in (text, f"@ros2_lv/0/ab/0/0/{text}", f"{LISTENER[:-8]}{text}"):
        try:
            parse_token(token)
        except NameMistakeError as error:
            said = str(error)
        else:
            said = ""
        assert "\n" not in said


def test_a_humble_node_is_known_by_its_missing_hash():
    endpoint = parse_token(LISTENER.replace(STRING, NO_HASH))
    assert isinstance(endpoint, Endpoint)
    assert endpoint.type_hash == NO_HASH


@pytest.mark.parametrize("name", ["", "1x", "/a//b", "/a/", "a b", "/ä", "~x", "/a__b", "x" * 256])
def test_names_that_ros_does_not_allow_are_refused(name):
    with pytest.raises(NameMistakeError, match="allowed: letters, digits"):
        check_name(name)


def test_types_have_their_dds_names():
    assert ros_type(dds_type("sensor_msgs/msg/Image")) == "sensor_msgs/msg/Image"
    for wrong in ("Image", "sensor_msgs/Image", "a/b/c", "sensor_msgs/msg/Im age"):
        with pytest.raises(NameMistakeError, match="expected package/msg/Name"):
            dds_type(wrong)


@pytest.mark.parametrize("domain", [-1, 233])
def test_a_domain_that_ros_does_not_have_is_refused(domain):
    with pytest.raises(NameMistakeError, match="allowed: 0 to 232"):
        watched_tokens(domain)


def test_an_attachment_has_zenohs_own_bytes():
    """Against the serializer of the Zenoh library, with which rmw_zenoh writes it."""
    gid = bytes(range(16))
    values = (zenoh.ext.Int64(5), zenoh.ext.Int64(-7), gid)
    expected = bytes(zenoh.ext.z_serialize(values))
    assert Attachment(5, -7, gid).encoded() == expected
    assert len(expected) == 33
    assert parse_attachment(expected) == Attachment(5, -7, gid)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "has 0 bytes, expected 33"),
        (bytes(32), "has 32 bytes, expected 33"),
        (bytes(34), "has 34 bytes, expected 33"),
        (bytes(33), "an identifier of 0 bytes, expected 16"),
        (b"\x0fsequence_number" + bytes(40), "rmw_zenoh before 0.2.4"),
    ],
)
def test_an_attachment_of_other_releases_is_told(data, reason):
    with pytest.raises(AttachmentError, match=reason):
        parse_attachment(data)


@given(st.binary(max_size=80))
def test_no_bytes_are_more_than_a_mistake(data):
    try:
        read = parse_attachment(data)
    except AttachmentError:
        read = None
    assert read is None or read.encoded() == data
