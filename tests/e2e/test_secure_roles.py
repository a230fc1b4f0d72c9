"""Invitations and their limits, and a commit that is recorded and sent again by everybody."""

import json
import socket
import threading
from contextlib import ExitStack, closing, suppress

import pytest
from processes import PATIENCE_S, keys_of, wait_for
from strangers import SILENCE_S, Stranger, certificates_on, options_of

from conductor.bench.own import noop_campaign
from conductor.commands.client import ConductorClient
from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Hello, Next, Reply, noop_result
from twin.base.errors import TwinError
from twin.base.software import software_digest
from twin.fabric.discovery import find_conductor
from twin.fabric.keys.authority import load_authority
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.rights import Act, may
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

CASES = 4


@pytest.fixture
def state(marked, tmp_path, request):
    """The folder of a conductor that listens with keys of its own making."""
    folder = tmp_path / "state"
    child = marked.start("conductor", "serve", "--state", str(folder), "--listen", "tcp/0.0.0.0:0")

    def found():
        try:
            return find_conductor(folder)
        except TwinError:
            return None

    wait_for(found, "the conductor")
    yield folder
    child.terminate()
    _, err = child.communicate()
    assert "Traceback" not in err
    refused = {line.partition(": ")[2] for line in err.splitlines() if "refused a conn" in line}
    if "recorded" in request.node.name:
        met = {"it does not speak TLS", "it showed no key", "its key is of another fabric or rig"}
        assert met <= refused, "the listener says why, too"


def test_an_invitation_opens_what_its_role_may_and_nothing_else(marked, state, tmp_path):
    invited = {}
    for role in ("viewer", "worker", "admin", "submitter"):
        invited[role] = str(tmp_path / f"{role}.key")
        made = marked.run(
            *("conductor", "invite", "--role", role, "--state", str(state), "-o", invited[role])
        )
        assert (made.returncode, made.stdout.strip()) == (0, invited[role]), made.stderr
    line = marked.run("conductor", "invite", "--role", "viewer", "--state", str(state))
    assert len(line.stdout.splitlines()) == 1
    pasted = tmp_path / "pasted"
    pasted.write_text(line.stdout)
    pasted.chmod(0o600)
    expired = tmp_path / "expired.key"
    expired.write_bytes(load_authority(keys_of(state)).issue(Role.admin, -1))
    expired.chmod(0o600)
    commands = tmp_path / "commands.yaml"
    text = "campaign: mine\nsimulator: noop\nautonomy: {command: [id]}\nmatrix: {repeat: [0]}\n"
    commands.write_text(text)
    endpoint = find_conductor(state).endpoint
    cancel = ("conductor", "cancel", "chaos-16")
    started = [
        (code, words, marked.start(*command, "--key", str(key)))
        for command, key, code, words in (
            # Nothing but the key is given: it says where the conductor is.
            (("conductor", "status"), invited["viewer"], 0, ""),
            (("conductor", "status"), pasted, 0, ""),
            (("conductor", "submit", "chaos-16"), invited["submitter"], 0, ""),
            (("conductor", "submit", str(commands)), invited["admin"], 2, "--role submitter"),
            (("conductor", "stop"), invited["submitter"], 2, "invite --role admin"),
            (("conductor", "stop"), invited["viewer"], 2, "invite --role admin"),
            (("conductor", "submit", "aeb-demo"), pasted, 2, "invite --role submitter"),
            (cancel, invited["worker"], 2, "key of role worker may not ask conductor/rpc/admin"),
            (("viewer", "pause", "a"), invited["viewer"], 2, "invite --role admin"),
            (
                ("conductor", "relay", "--listen", "tls/127.0.0.1:0"),
                invited["worker"],
                2,
                "a relay",
            ),
            (("twin", "worker"), invited["viewer"], 2, "invite --role worker"),
            ((*cancel, "--connect", endpoint), expired, 2, "this key expired on"),
            (
                ("conductor", "serve", "--state", str(tmp_path / "s")),
                invited["admin"],
                2,
                "may not",
            ),
        )
    ]
    for code, words, child in started:
        _, err = child.communicate()
        assert (child.returncode, words in err) == (code, True), (child.args, err)
        assert len([line for line in err.splitlines() if not line.startswith("INFO")]) == code // 2
    found = json.loads(
        marked.run("conductor", "status", "--state", str(state), "--output", "json").stdout
    )
    assert (found["campaigns"]["chaos-16"]["left"], found["workers"]) == (16, [])
    for options, words in (
        (
            ("--role", "conductor"),
            "allowed: viewer, worker, admin, submitter; a conductor has its own key",
        ),
        (("--role", "stack"), "a stack gets one from its rig"),
        (("--role", "viewer", "--days", "400"), "allowed: 1 to 36"),
        (("--role", "viewer", "--connect", "tcp/10.0.0.1:7447"), "use tls/10.0.0.1:7447"),
    ):
        refused = marked.run("conductor", "invite", "--state", str(state), *options)
        assert refused.returncode == 2
        assert words in refused.stderr
    (keys_of(state) / "authority.key").unlink()
    gone = marked.run("conductor", "invite", "--role", "viewer", "--state", str(state))
    assert (gone.returncode, "was removed" in gone.stderr) == (2, True)


@pytest.fixture
def stack(state):
    """What is closed before the conductor is stopped, also after a failure."""
    with ExitStack() as found:
        yield found


class Tap:
    """Somebody on the wire between a worker and its conductor who keeps every byte."""

    def __init__(self, port):
        self.sent, self.answered = bytearray(), bytearray()
        self._port = port
        self._ends = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tls/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        try:
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
                self._ends += (near, far)
                for way in ((near, far, self.sent), (far, near, self.answered)):
                    threading.Thread(target=self._pump, args=way, daemon=True).start()
        except OSError:
            return

    def _pump(self, source, sink, kept):
        try:
            while data := source.recv(65536):
                kept += data
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    def close(self):
        for each in (self._listener, *self._ends):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()


def ask(bus, request):
    data = bus.request(topics.RPC_WORKER.key, encode(request), PATIENCE_S)
    assert data is not None
    return decode(data, Reply)


def hello(worker):
    own = (SCHEMA_VERSION, worker, "h", 1, "cpu:test", software_digest(), 1)
    return Hello(*own, session=SECRETS[worker])


SECRETS = {"first": bytes(32), "second": bytes(range(32))}
"""Of the sessions of two workers."""


def test_a_recorded_commit_sent_again_changes_nothing(state, tmp_path, stack):
    """By somebody without a key, as bytes and as messages; by every other role; by a worker."""
    keys = keys_of(state)
    port = int(find_conductor(state).endpoint.rpartition(":")[2])
    tap = stack.enter_context(closing(Tap(port)))
    with ConductorClient("", state, "twin", role=Role.submitter) as client:
        client.submit(noop_campaign(CASES), "")
    name = noop_campaign(CASES).campaign
    bus = open_bus("client", connect=[tap.endpoint], key=load_key(keys, Role.worker))
    stack.callback(bus.close)
    ask(bus, hello("first"))
    (lease,) = ask(bus, Next(SCHEMA_VERSION, "first", 1, 1, session=bytes(32))).leases
    done = [noop_result(lease)]
    commit = Next(SCHEMA_VERSION, "first", 2, 0, results=done, session=bytes(32))
    recorded = encode(commit)
    assert ask(bus, commit).acks == [lease.token]

    def rows():
        with ConductorClient("", state, "twin") as client:
            found = client.status()
        return {
            "campaign": {
                key: value for key, value in found["campaigns"][name].items() if "_s" not in key
            },
            "facts": found["counters"]["fenced"],
            "workers": [worker["id"] for worker in found["workers"]],
        }

    before = rows()
    assert (before["campaign"]["left"], before["workers"]) == (CASES - 1, ["first"])
    secrets = [lease.case.id.encode(), recorded, b"conductor/rpc"]
    assert tap.sent
    assert not [word for word in secrets if word in tap.sent + tap.answered], "nothing is read"
    # Every byte of the worker's session on a new connection, cut and whole; and the bare message.
    for data in (bytes(tap.sent), bytes(tap.sent[:600]), recorded, b"\x00\x10" + recorded):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.settimeout(10.0)
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            answer = bytearray()
            try:
                while more := connection.recv(65536):
                    answer += more
            except OSError:
                pass
        assert not [word for word in secrets if word in answer]
    for kind, tls in certificates_on(keys, tmp_path).items():
        protocol = "tcp" if kind == "plain" else "tls"
        stranger = Stranger(f"{protocol}/127.0.0.1:{port}", tls)
        assert not stranger.inside, kind
    # With a key of another role, and no rule of ours minded.
    for role in (Role.viewer, Role.admin, Role.submitter):
        tls = options_of(load_key(keys, role))
        member = Stranger(f"tls/127.0.0.1:{port}", tls, PATIENCE_S)
        stack.callback(member.close)
        assert member.inside
        rpc = (topics.RPC_WORKER, topics.RPC_STATUS, topics.RPC_ADMIN, topics.RPC_SUBMIT)
        doors = [door.key for door in rpc]
        opened = [door for door in doors if may(role, Act.ask, door)]
        for (answer,) in member.answers([(door, recorded) for door in opened], PATIENCE_S):
            assert f"send it to {topics.RPC_WORKER.key}" in decode(answer, Reply).error
        shut = [(door, data) for door in doors if door not in opened for data in (recorded, b"")]
        assert member.answers(shut, SILENCE_S) == [[]] * len(shut)
        assert (topics.RPC_ADMIN.key in opened) is (role is Role.admin)
        assert (topics.RPC_SUBMIT.key in opened) is (role is Role.submitter)
    assert rows() == before
    # By the worker again: the same answer. By another worker, in its own name: fenced.
    assert ask(bus, commit).acks == [lease.token]
    assert rows() == before
    ask(bus, hello("second"))
    forged = noop_result(lease)
    for seq, stolen in enumerate((forged, changed(forged)), start=1):
        request = Next(
            SCHEMA_VERSION, "second", seq, 0, results=[stolen], session=SECRETS["second"]
        )
        assert ask(bus, request).fenced == [lease.token], "it is another worker's token"
    assert rows()["campaign"] == before["campaign"], "nor is it evidence of anything"
    # In the first one's name, without its secret: nothing at all.
    named = Next(SCHEMA_VERSION, "first", 3, 1, session=SECRETS["second"])
    assert "secret is not that of the process that joined" in ask(bus, named).error


def changed(result):
    """The same token with another verdict."""
    import msgspec

    return msgspec.structs.replace(result, verdict="collision", kpi_sha256="0" * 64)
