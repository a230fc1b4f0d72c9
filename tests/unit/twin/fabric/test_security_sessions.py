"""Sessions over mutual TLS, and everybody who must get nothing from them."""

import base64
import dataclasses
import json
import os
import socket
import threading

import msgspec
import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from waiting import PATIENCE_S

from schemas.wire import topics
from twin.base.errors import UnreachableError, UsageError
from twin.fabric.discovery import FILE_NAME, ConductorFile, await_conductor
from twin.fabric.handshake import greet
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.key_file import MemberKey, UnfitKeyError, load_key
from twin.fabric.keys.rig_keys import RigKeys
from twin.fabric.keys.roles import MEMBERS, Role
from twin.fabric.zenoh_bus import open_bus

LISTEN = ["tls/127.0.0.1:0"]
SHOWN = topics.VIEW_THUMBNAIL.key.format(campaign="c", case="1")


RPC = topics.RPC_WORKER.key


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    """Role -> its key, of one fabric."""
    folder = make_keys(tmp_path_factory.mktemp("ours") / "keys")
    return {role: load_key(folder, role) for role in MEMBERS}


@pytest.fixture
def key(keys):
    return keys[Role.worker]


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """A worker's key of another fabric."""
    return load_key(make_keys(tmp_path_factory.mktemp("others") / "theirs"), Role.worker)


@pytest.fixture
def router(keys):
    bus = open_bus("router", listen=LISTEN, key=keys[Role.conductor])
    bus.serve(RPC, lambda payload, respond: respond(payload + b"!"))
    yield bus
    bus.close()


def stranger(endpoint, patience_s=0.5, *, authority=None, certificate=None, private=None):
    """A Zenoh session of somebody who minds no rule of ours; None if the door stays shut."""
    config = zenoh.Config()
    tls = {"verify_name_on_connect": False}
    if authority:
        tls["root_ca_certificate_base64"] = base64.b64encode(authority).decode()
    if certificate:
        tls["enable_mtls"] = True
        tls["connect_certificate_base64"] = base64.b64encode(certificate).decode()
        tls["connect_private_key_base64"] = base64.b64encode(private).decode()
    for name, value in {
        "mode": "client",
        "namespace": "twin",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": int(1000 * patience_s),
        "scouting/multicast/enabled": False,
        "transport/link/tls": tls,
    }.items():
        config.insert_json5(name, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        return None


def test_the_right_key_opens(router, key):
    assert router.endpoints[0].startswith("tls/127.0.0.1:")
    client = open_bus("client", connect=router.endpoints, key=key)
    try:
        assert client.request(RPC, b"hi", PATIENCE_S) == b"hi!"
    finally:
        client.close()


def test_a_host_name_does_not_matter(router, key):
    named = router.endpoints[0].replace("127.0.0.1", "localhost")
    client = open_bus("client", connect=[named], key=key)
    try:
        assert client.request(RPC, b"hi", PATIENCE_S) == b"hi!"
    finally:
        client.close()


def test_strangers_stay_outside(router, key, other):
    """Plain TCP; TLS without a certificate; another authority; the right one with another leaf."""
    endpoint = router.endpoints[0]
    heard = threading.Event()
    router.subscribe("**", lambda _: heard.set())
    tries = {
        "plain": stranger("tcp" + endpoint[3:]),
        "no certificate": stranger(endpoint, authority=key.authority),
        "own authority": stranger(
            endpoint,
            authority=other.authority,
            certificate=other.certificate,
            private=other.private,
        ),
        "own certificate": stranger(
            endpoint,
            authority=key.authority,
            certificate=other.certificate,
            private=other.private,
        ),
        "stolen certificate, own private key": stranger(
            endpoint, authority=key.authority, certificate=key.certificate, private=other.private
        ),
    }
    assert tries == dict.fromkeys(tries)
    assert not heard.is_set()
    member = open_bus("client", connect=[endpoint], key=key)
    try:
        member.publish(SHOWN, b"", block=True)
        assert heard.wait(PATIENCE_S), "and members are still served"
    finally:
        member.close()


@pytest.fixture
def between(other):
    """Somebody who stands between two members with a certificate of another authority.

    Yields its endpoint and an event: it got a message, a request or a sign of life.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{free.getsockname()[1]}"
    config = zenoh.Config()
    for name, value in {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tls": {
            "listen_certificate_base64": base64.b64encode(other.certificate).decode(),
            "listen_private_key_base64": base64.b64encode(other.private).decode(),
        },
    }.items():
        config.insert_json5(name, json.dumps(value))
    heard = threading.Event()
    with zenoh.open(config) as session:
        session.declare_queryable("**", lambda _: heard.set())
        session.declare_subscriber("**", lambda _: heard.set())
        session.liveliness().declare_subscriber("**", lambda _: heard.set())
        yield endpoint, heard


def test_a_trusted_authority_alone_is_not_enough(between, key, other):
    """When it connects, Zenoh trusts public web authorities as well; the name tells members.

    The web's authority is played by the other key's: the client is made to trust it.
    """
    endpoint, heard = between
    trusting = dataclasses.replace(key, authority=key.authority + other.authority)
    client = open_bus("client", connect=[endpoint], key=trusting)
    try:
        client.announce("worker/w1")
        client.publish(SHOWN, b"secret", block=True)
        assert client.request(RPC, b"secret", 0.5) is None
        assert not heard.is_set()
    finally:
        client.close()
    careless = stranger(endpoint, PATIENCE_S, authority=other.authority)
    careless.put("x", b"secret")
    assert heard.wait(PATIENCE_S), "so this test can fail"
    careless.close()


def test_a_wrong_key_is_told_from_silence(router, key, other):
    with pytest.raises(UsageError, match=r"refused: it is of another fabric than .*theirs"):
        open_bus("client", connect=router.endpoints, key=other)
    with pytest.raises(UsageError, match="needs a key of the fabric"):
        open_bus("client", connect=router.endpoints)
    with pytest.raises(UnreachableError, match="nobody answers after"):
        open_bus("client", connect=["tls/127.0.0.1:1"], key=key, connect_timeout_s=0.2)
    plain = "tcp" + router.endpoints[0][3:]
    with pytest.raises(UnreachableError, match=r"opened no session.* reached by tls/ and --key"):
        open_bus("client", connect=[plain], connect_timeout_s=0.3)


def test_tls_to_a_plain_conductor_is_named(key):
    plain = open_bus("router", listen=["tcp/127.0.0.1:0"])
    try:
        endpoint = "tls" + plain.endpoints[0][3:]
        with pytest.raises(UnreachableError, match="does not speak TLS"):
            greet(endpoint, key, timeout_s=0.3)
    finally:
        plain.close()


def test_an_expired_certificate_on_the_other_side_is_named(tmp_path):
    """Where the other side's clock, and so its loader, is behind ours."""
    keys = make_keys(tmp_path / "keys")
    data = load_authority(keys).issue(Role.conductor, -1)
    certificate, authority = (
        found.public_bytes(Encoding.PEM) for found in x509.load_pem_x509_certificates(data)
    )
    private = data.removeprefix(certificate).removesuffix(authority)
    ours = load_key(keys, Role.worker)
    expired = MemberKey(tmp_path, authority, certificate, private, ours.fabric, Role.conductor)
    bus = open_bus("router", listen=LISTEN, key=expired)
    try:
        with pytest.raises(UsageError, match="certificate has expired; compare the clocks"):
            greet(bus.endpoints[0], ours)
    finally:
        bus.close()


def test_garbage_on_the_port_ends_nothing(router, key):
    port = int(router.endpoints[0].rpartition(":")[2])
    idle = []
    for data in (b"", b"\x16\x03\x01\xff\xff", os.urandom(4000), b"GET / HTTP/1.1\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(data)
        idle.append(socket.create_connection(("127.0.0.1", port)))
    client = open_bus("client", connect=router.endpoints, key=key)
    try:
        assert client.request(RPC, b"hi", PATIENCE_S) == b"hi!"
    finally:
        client.close()
        for connection in idle:
            connection.close()


def test_peers_and_liveliness_over_tls():
    """The drive plane: simulator listens, stack connects; both are peers."""
    rig = RigKeys("rig")
    key = load_key(rig.simulator, Role.worker)
    simulator = open_bus("peer", listen=LISTEN, key=key, namespace="twin/rig")
    came, went = threading.Event(), threading.Event()
    simulator.announce(topics.SIMULATOR_ALIVE.key.format(rig="rig"))
    try:
        stack = open_bus(
            "peer",
            connect=simulator.endpoints,
            key=load_key(rig.stack, Role.stack),
            namespace="twin/rig",
        )
        alive = topics.SIMULATOR_ALIVE.key.format(rig="*")
        stack.watch(alive, lambda _, alive: (came if alive else went).set())
        assert came.wait(PATIENCE_S)
        simulator.close()
        assert went.wait(PATIENCE_S)
        stack.close()
    finally:
        simulator.close()
        rig.close()


def test_plain_beyond_loopback_is_refused_before_it_listens():
    with pytest.raises(UsageError, match="plain TCP is for this host's loopback only"):
        open_bus("router", listen=["tcp/0.0.0.0:0"])
    with pytest.raises(UsageError, match="needs a key of the fabric"):
        open_bus("router", listen=["tls/0.0.0.0:0"])


def announce(folder, endpoint, key=""):
    content = ConductorFile(endpoint, 1, "h", 1, "twin", "0", key)
    (folder / FILE_NAME).write_bytes(msgspec.json.encode(content))


def test_the_key_is_found_where_conductor_json_says(router, key, tmp_path):
    announce(tmp_path, router.endpoints[0])
    with pytest.raises(UnfitKeyError, match="names no keys outside of its folder"):
        await_conductor(tmp_path, 3600, Role.worker)
    announce(tmp_path, router.endpoints[0], str(key.path.parent))
    assert await_conductor(tmp_path, 0, Role.worker).key == key


def test_a_loose_key_is_not_waited_for(router, key, tmp_path):
    state, loose = tmp_path / "state", tmp_path / "mine/worker.key"
    for folder in (state, loose.parent):
        folder.mkdir()
    loose.write_bytes(key.path.read_bytes())
    loose.chmod(0o644)
    announce(state, router.endpoints[0], str(loose.parent))
    with pytest.raises(UsageError, match="chmod 600"):
        await_conductor(state, 3600, Role.worker)


def test_a_given_key_wins(router, key, other, tmp_path):
    announce(tmp_path, router.endpoints[0], str(key.path.parent))
    with pytest.raises(UsageError, match="another fabric"):
        await_conductor(tmp_path, 0, Role.worker, other.path)


def test_a_relay_passes_everything_on(router, key, keys):
    """Requests, liveliness and views, for those who can reach only the relay."""
    came = threading.Event()
    router.watch("worker/*", lambda _, alive: came.set() if alive else None)
    relay = open_bus("router", listen=LISTEN, connect=router.endpoints, key=keys[Role.conductor])
    feed = open_bus("peer", connect=router.endpoints, key=key, connect_required=False)
    far = open_bus("client", connect=relay.endpoints, key=key)
    viewer = open_bus("client", connect=relay.endpoints, key=keys[Role.viewer])
    try:
        far.announce("worker/w1")
        assert came.wait(PATIENCE_S)
        assert request_until_answered(far) == b"hi!"
        seen = threading.Event()
        assert not feed.wanted("view/c/1/thumbnail")
        viewer.subscribe("view/*/*/thumbnail", lambda _: seen.set())
        while not seen.wait(0.05):
            if feed.wanted("view/c/1/thumbnail"):
                feed.publish("view/c/1/thumbnail", b"picture")
    finally:
        for bus in (viewer, far, feed, relay):
            bus.close()


def request_until_answered(bus):
    """Routes between two routers take a moment; members repeat their requests anyway."""
    while True:
        answer = bus.request(RPC, b"hi", 1)
        if answer is not None:
            return answer
