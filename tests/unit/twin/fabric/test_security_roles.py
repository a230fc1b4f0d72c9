"""Every role at every key, over real sessions: programs that mind no rule get what the table says.

The router has the fabric's access list; the session under test is Zenoh's own with a role's
certificate and no list, so what it is denied it is denied by those who receive. A denied message
leaves no trace: each try ends with a key that everybody is allowed here, and messages of a link
keep their order.
"""

import base64
import contextlib
import json
import socket
import threading

import pytest
import zenoh
from waiting import PATIENCE_S

from schemas.wire import topics
from twin.fabric.endpoint import SOCKET
from twin.fabric.front.router import Fronted
from twin.fabric.keys import rights
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.key_file import UnfitKeyError, WrongRoleError, load_key
from twin.fabric.keys.rights import MAY, Act, may, pattern
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

NAMESPACE = "twin/rig"
KEYS = sorted(
    {pattern(topic).replace("*", "x") for topic in topics.TOPICS}
    | {topics.READY.key.format(rig="x", side=side) for side in ("simulator", "stack")}
    | {topics.sensor_key("x", "camera.front_left"), topics.sensor_key("x", "lidar.roof")}
    | {"conductor/rpc", "conductor/rpc/x", "worker/x/y", "x"}
)
"""A key of every topic, both sides' handshake, and some that nobody knows."""
END = "end/of/try"
OUTSIDERS = [role for role in Role if role is not Role.conductor]


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = make_keys(tmp_path_factory.mktemp("ours") / "keys")
    # No conductor's fabric has a stack; a rig's has, and the same table.
    stack = folder / "stack.key"
    stack.touch(0o600)
    stack.write_bytes(load_authority(folder).issue(Role.stack, 1))
    return {role: load_key(folder, role) for role in Role}


def lawless(endpoint, key, namespace=NAMESPACE):
    """A session that shows ``key``, or none, and has no access list: it tries everything.

    ``namespace`` None: its keys are whole ones, of any namespace.
    """
    config = zenoh.Config()
    own = (
        {}
        if key is None
        else {
            "connect_certificate_base64": base64.b64encode(key.certificate).decode(),
            "connect_private_key_base64": base64.b64encode(key.private).decode(),
            "root_ca_certificate_base64": base64.b64encode(key.authority).decode(),
        }
    )
    for name, value in {
        "mode": "client",
        **({"namespace": namespace} if namespace is not None else {}),
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tls": {"enable_mtls": True, "verify_name_on_connect": False, **own},
    }.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


class Ear:
    """Keys that a callback was told; END is awaited, not kept."""

    def __init__(self):
        self.keys = set()
        self._end = threading.Event()

    def __call__(self, sample):
        key = str(sample.key_expr)
        if key == END:
            self._end.set()
        else:
            self.keys.add(key)

    def ended(self, wait_s=PATIENCE_S):
        return self._end.wait(wait_s)


def put(session, key):
    session.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)


def published(tested, member):
    """Keys on which a member hears what ``tested`` publishes or deletes."""
    ear = Ear()
    with member.declare_subscriber("**", ear):
        while not ear.ended(0.05):  # until the subscription stands
            put(tested, END)
        again = Ear()
        with member.declare_subscriber("**", again):
            for key in KEYS:
                put(tested, key)
                tested.delete(key)
            while not again.ended(0.05):
                put(tested, END)
    return ear.keys | again.keys


def subscribed(tested, member):
    """Keys on which ``tested`` hears a member, asking for each and for all."""
    ears = [Ear(), Ear()]
    declared = [tested.declare_subscriber(key, ears[0]) for key in [*KEYS, "**", END]]
    while not ears[0].ended(0.05):
        put(member, END)
    declared.append(tested.declare_subscriber("**", ears[1]))
    for key in KEYS:
        put(member, key)
    while not ears[1].ended(0.05):
        put(member, END)
    for subscriber in declared:
        subscriber.undeclare()
    return ears[0].keys | ears[1].keys


def questioned(tested, member):
    """Keys on which a member is asked by ``tested``, each alone and all at once, and answers."""
    heard = set()

    def answer(query):
        heard.add(str(query.key_expr))
        query.reply(query.key_expr, b"yes")

    declared = [member.declare_queryable(key, answer) for key in [*KEYS, END]]
    until_answered(tested, END)
    found = {key for key in [*KEYS, "**"] if replies(tested, key)}
    for queryable in declared:
        queryable.undeclare()
    assert heard - {END} == found
    return found


def answered(tested, member):
    """Keys on which a member is answered by ``tested``, offering each and all."""
    declared = [
        tested.declare_queryable(key, lambda query: query.reply(query.key_expr, b"no"))
        for key in ["**", *KEYS, END]
    ]
    until_answered(member, END)
    found = {key for key in KEYS if replies(member, key)}
    for queryable in declared:
        queryable.undeclare()
    return found


def replies(session, key):
    return [reply for reply in session.get(key, timeout=PATIENCE_S) if reply.ok]


def until_answered(session, key):
    while not replies(session, key):
        threading.Event().wait(0.02)


def announced(tested, member):
    """Keys on which a member sees ``tested`` alive."""
    return alive(tested, member)


def watched(tested, member):
    """Keys on which ``tested`` sees a member alive."""
    return alive(member, tested)


def alive(session, other):
    """Keys on which ``other`` is told that ``session`` is alive."""
    tokens = [session.liveliness().declare_token(key) for key in [*KEYS, END]]
    told, gone = Ear(), Ear()

    def hear(sample):
        (told if sample.kind == zenoh.SampleKind.PUT else gone)(sample)

    listening = [
        other.liveliness().declare_subscriber(key, hear, history=True) for key in ["**", *KEYS, END]
    ]
    assert told.ended()
    for token in tokens:
        token.undeclare()
    assert gone.ended(), "or the next try hears of these"
    for subscriber in listening:
        subscriber.undeclare()
    return told.keys


TRIES = {
    Act.publish: published,
    Act.subscribe: subscribed,
    Act.ask: questioned,
    Act.answer: answered,
    Act.announce: announced,
    Act.watch: watched,
}


@contextlib.contextmanager
def end_allowed(monkeypatch):
    """Sessions that are opened meanwhile allow END to everybody."""
    open_end = {
        role: {act: (*allowed.get(act, ()), END) for act in Act} for role, allowed in MAY.items()
    }
    with monkeypatch.context() as patched:
        patched.setattr(rights, "MAY", open_end)
        yield


def open_to_the_end(keys, monkeypatch):
    """A router with the fabric's access list, and END allowed to everybody."""
    with end_allowed(monkeypatch):
        return open_bus(
            "router", listen=["tls/127.0.0.1:0"], key=keys[Role.conductor], namespace=NAMESPACE
        )


def test_every_role_at_every_key(keys, monkeypatch):
    """What is let through is what the table says, no more and no less."""
    router = open_to_the_end(keys, monkeypatch)
    endpoint = router.endpoints[0]
    denied = 0
    with lawless(endpoint, keys[Role.conductor]) as member:
        for role in Role:
            with lawless(endpoint, keys[role]) as tested:
                for act, attempt in TRIES.items():
                    asked = [*KEYS, "**"] if act is Act.ask else KEYS
                    expected = {key for key in asked if may(role, act, key)}
                    assert attempt(tested, member) == expected, (role, act)
                    denied += len(KEYS) - len(expected)
    router.close()
    assert denied > 900, "and most of it is denied"


def test_who_comes_past_the_front_may_do_what_a_worker_may(keys, monkeypatch):
    """By the socket that workers of a run are handed, and without a key: the same at every key."""
    with end_allowed(monkeypatch):
        fronted = Fronted("tls/127.0.0.1:0", NAMESPACE, keys[Role.conductor], lambda _: None)
    door = f"{SOCKET}//proc/self/fd/{fronted.socket_of(Role.worker)}"
    try:
        with (
            lawless(fronted.bus.endpoints[0], keys[Role.conductor]) as member,
            lawless(door, None) as tested,
        ):
            for act, attempt in TRIES.items():
                asked = [*KEYS, "**"] if act is Act.ask else KEYS
                assert attempt(tested, member) == {
                    key for key in asked if may(Role.worker, act, key)
                }, act
    finally:
        fronted.close()


def test_who_is_alive_is_listed_to_those_who_may_watch(keys, monkeypatch):
    router = open_to_the_end(keys, monkeypatch)
    endpoint = router.endpoints[0]
    with lawless(endpoint, keys[Role.conductor]) as member:
        tokens = [member.liveliness().declare_token(key) for key in [*KEYS, END]]
        for role in Role:
            expected = {key for key in KEYS if may(role, Act.watch, key)} | {END}
            listed = set()
            with lawless(endpoint, keys[role]) as tested:
                while not listed >= expected:  # an answer may miss what a crowded router has
                    for key in ["**", *KEYS, END]:
                        answer = tested.liveliness().get(key, timeout=PATIENCE_S)
                        listed |= {str(reply.ok.key_expr) for reply in answer if reply.ok}
            assert listed == expected, role
        for token in tokens:
            token.undeclare()
    router.close()


def test_the_table_keeps_what_matters_apart():
    able = {
        (act, key): {role for role in OUTSIDERS if may(role, act, key)}
        for act in Act
        for key in KEYS
    }
    assert set(MAY[Role.viewer]) == {Act.subscribe, Act.ask}, "a viewer says nothing"
    assert able[Act.ask, topics.RPC_ADMIN.key] == {Role.admin}
    assert able[Act.ask, topics.RPC_SUBMIT.key] == {Role.submitter}, "what runs code is apart"
    assert able[Act.ask, topics.RPC_WORKER.key] == {Role.worker}
    lookers = {Role.viewer, Role.admin, Role.submitter}
    assert able[Act.ask, topics.RPC_STATUS.key] == {Role.worker, *lookers}
    assert able[Act.ask, topics.CASE_FILES.key] == lookers, "no worker, and no stack"
    assert able[Act.ask, pattern(topics.VIEW_CONTROL).replace("*", "x")] == {Role.admin}
    command = topics.COMMAND.key.format(rig="x")
    assert able[Act.publish, command] == {Role.stack}
    assert able[Act.subscribe, command] == {Role.worker}
    for (act, key), who in able.items():
        if key.startswith("conductor/") and act is not Act.ask:
            assert who <= lookers, (act, key)
            assert act is Act.subscribe or not who, (act, key)
        if Role.stack in who:
            assert key.startswith("drive/"), "a stack sees a drive plane and nothing else"
        assert not may(Role.viewer, act, "**")


def test_a_namespace_of_another_rig_is_none_of_a_stacks(keys):
    """A listener lets nobody reach beyond the namespace that it serves."""
    router = open_bus(
        "router", listen=["tls/127.0.0.1:0"], key=keys[Role.worker], namespace=NAMESPACE
    )
    command, tick = (t.key.format(rig="x") for t in (topics.COMMAND, topics.TICK))
    other = "twin/other"
    try:
        # What a stack and its simulator may do in their own namespace; without one of their own
        # they name any, and messages of a link keep their order.
        with (
            lawless(router.endpoints[0], keys[Role.stack], namespace=None) as stack,
            lawless(router.endpoints[0], keys[Role.worker], namespace=None) as simulator,
        ):
            ears = {}
            for speaker, hearer, key in ((stack, simulator, command), (simulator, stack, tick)):
                ears[key] = keys_heard, own = set(), threading.Event()

                def hear(sample, keys_heard=keys_heard, own=own):
                    keys_heard.add(str(sample.key_expr))
                    if str(sample.key_expr).startswith(NAMESPACE):
                        own.set()

                for space in (other, NAMESPACE):
                    hearer.declare_subscriber(f"{space}/{key}", hear)
                while not own.wait(0.05):  # until the subscription stands
                    put(speaker, f"{NAMESPACE}/{key}")
                own.clear()
                put(speaker, f"{other}/{key}")
                put(speaker, f"{NAMESPACE}/{key}")
                assert own.wait(PATIENCE_S)
                assert keys_heard == {f"{NAMESPACE}/{key}"}
    finally:
        router.close()


def test_what_a_role_may_not_is_said_before_it_is_sent(keys):
    """A denied call would be silent; ours names the key's file, its role and the one it takes."""
    router = open_bus("router", listen=["tls/127.0.0.1:0"], key=keys[Role.conductor])
    refused = 0
    try:
        for role in OUTSIDERS:
            bus = open_bus("client", connect=router.endpoints, key=keys[role])
            calls = {
                Act.publish: lambda key, bus=bus: bus.publish(key, b""),
                Act.subscribe: lambda key, bus=bus: bus.subscribe(key, lambda _: None),
                Act.ask: lambda key, bus=bus: bus.request(key, b"", 0.1),
                Act.answer: lambda key, bus=bus: bus.serve(key, lambda _p, _r: None),
                Act.announce: lambda key, bus=bus: bus.announce(key),
                Act.watch: lambda key, bus=bus: bus.watch(key, lambda _k, _a: None),
            }
            for act, call in calls.items():
                for key in KEYS:
                    if may(role, act, key):
                        continue
                    with pytest.raises(WrongRoleError, match=f"role {role} may not") as error:
                        call(key)
                    assert str(keys[role].path) in str(error.value)
                    assert len(str(error.value).splitlines()) == 1
                    refused += 1
            bus.close()
        assert refused > 900
        viewer = open_bus("client", connect=router.endpoints, key=keys[Role.viewer])
        with pytest.raises(WrongRoleError, match=r"ask for one by `conductor invite --role admin`"):
            viewer.request(topics.RPC_ADMIN.key, b"", 1.0)
        viewer.close()
        assert rights.refusal(Role.stack, Act.ask, topics.RPC_STATUS.key).endswith(
            "allowed: viewer or worker or admin or submitter; "
            "ask for one by `conductor invite --role viewer`"
        ), "the least that is enough"
        command = topics.COMMAND.key.format(rig="x")
        assert rights.refusal(Role.worker, Act.publish, command).endswith(
            "allowed: stack; its rig gives it that one"
        )
    finally:
        router.close()


def impostor(key):
    """A router without an access list that shows ``key``, and its endpoint."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{free.getsockname()[1]}"
    config = zenoh.Config()
    for name, value in {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tls": {
            "listen_certificate_base64": base64.b64encode(key.certificate).decode(),
            "listen_private_key_base64": base64.b64encode(key.private).decode(),
        },
    }.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config), endpoint


def test_nobody_poses_as_a_conductor(keys):
    """A viewer, a stack or an admin that listens is no place to connect to."""
    for role in (Role.viewer, Role.stack, Role.admin):
        false, endpoint = impostor(keys[role])
        heard = threading.Event()
        false.declare_queryable("**", lambda _, heard=heard: heard.set())
        false.declare_subscriber("**", lambda _, heard=heard: heard.set())
        with pytest.raises(UnfitKeyError, match=f"shows the certificate .* {role}'"):
            open_bus("client", connect=[endpoint], key=keys[Role.worker])
        # Without our look at the certificate the access list of the one who connects holds.
        bus = open_bus("peer", connect=[endpoint], key=keys[Role.worker], connect_required=False)
        assert bus.request(topics.RPC_WORKER.key, b"secret", 0.5) is None
        bus.announce(topics.WORKER_ALIVE.key.format(worker="w"))
        bus.close()
        assert not heard.is_set()
        false.close()
