"""A campaign over mutual TLS: same verdicts, and strangers get nothing of it."""

import json
import signal
import socket

import psutil
import pytest
from processes import PATIENCE_S, interrupt, wait_for
from strangers import Stranger, certificates_on

from schemas import SCHEMA_VERSION, topics
from schemas.messages import StatusRequest
from schemas.wire import encode
from twin.fabric.authority import make_keys
from twin.fabric.discovery import find_conductor
from twin.fabric.errors import TwinError


def ports(marked):
    """TCP ports on which processes of the test listen."""
    found = {}
    for process in marked.processes():
        try:
            for connection in process.net_connections("tcp"):
                if connection.status == psutil.CONN_LISTEN:
                    found[connection.laddr.port] = process.cmdline()[-1]
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found


def serving(marked, state, *options):
    """A conductor on ``state``, once it can be found."""
    child = marked.start("conductor", "serve", "--state", str(state), *options)

    def found():
        try:
            here = find_conductor(state)
        except TwinError:
            return None
        return here if here.pid == child.pid else None

    return child, wait_for(found, "the conductor")


def test_campaign_among_strangers(marked, quiet, tmp_path):
    """Conductor, simulator, recorder feed, a viewer's hub and gate listen; strangers stay out."""
    out = tmp_path / "chaos-16"
    run = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "1", "--slots", "4", "--out", str(out)),
        *("--listen", "tls/127.0.0.1:0", "--view", "record+live", "--output", "json"),
    )
    viewer = marked.start(
        *("viewer", "live", "--run", str(out), "--wait", "60", "--no-window", "--output", "json")
    )
    wait_for(lambda: marked.processes("record"), "the recorder")
    found = wait_for(lambda: len(ports(marked)) == 5 and ports(marked), "five listeners")
    secrets = [secret_of(path) for path in (out / "keys").iterdir()]
    assert len(secrets) == 6
    for kind, tls in certificates_on(out / "keys", tmp_path).items():
        for port in found:
            protocol = "tcp" if kind == "plain" else "tls"
            stranger = Stranger(f"{protocol}/127.0.0.1:{port}", tls)
            assert not stranger.inside, f"{kind} at {found[port]}"
    for process in marked.processes():
        shown = "".join([*process.cmdline(), *process.environ().values()])
        assert not [secret for secret in secrets if secret in shown]
    stdout, stderr = run.communicate()
    assert run.returncode == 1, stderr
    assert json.loads(stdout)["fingerprint"] == quiet["fingerprint"]
    assert not [secret for secret in secrets if secret in stdout + stderr]
    for path in out.rglob("*"):
        if path.is_file() and path.parent.name != "keys":
            data = path.read_bytes()
            assert not [secret for secret in secrets if secret.encode() in data], path
    interrupt(viewer)
    shown, _ = viewer.communicate()
    assert json.loads(shown.splitlines()[-1])["received"] > 0, "members see"
    recordings = list(out.glob("cases/*/attempt-*/recording.json"))
    assert len(recordings) == 16
    assert all(json.loads(path.read_text())["complete"] for path in recordings)


def secret_of(path):
    """A line of the private key."""
    return path.read_text().split("-----BEGIN PRIVATE KEY-----")[1].splitlines()[1]


def test_the_same_strangers_get_in_without_tls(marked, tmp_path):
    """So the test above can fail."""
    _, found = serving(marked, tmp_path / "state")
    stranger = Stranger(found.endpoint, {}, PATIENCE_S)
    try:
        assert stranger.inside
        request = encode(StatusRequest(v=SCHEMA_VERSION))
        assert stranger.answers([(topics.RPC_STATUS.key, request)], PATIENCE_S) != [[]]
    finally:
        stranger.close()
    for process in marked.processes("serve"):
        process.terminate()


@pytest.fixture
def locked(marked, tmp_path):
    """A conductor with a key of its own making, and another key."""
    state = tmp_path / "state"
    child, found = serving(marked, state, "--listen", "tcp/0.0.0.0:0")
    assert found.endpoint.startswith("tls/")
    other = make_keys(tmp_path / "other")
    yield state, found.endpoint, str(other)
    child.terminate()
    _, err = child.communicate()
    assert "Traceback" not in err


COMMANDS = [
    ("conductor", "submit", "chaos-16"),
    ("conductor", "status"),
    ("conductor", "cancel", "chaos-16"),
    ("conductor", "stop"),
    ("twin", "worker"),
    ("viewer", "live", "--no-window"),
    ("devkit", "host", "--rig", "r", "--stack", "devkit.aeb:AebStack"),
]


def test_every_command_without_the_key_is_refused(marked, locked):
    state, endpoint, other = locked
    started = [
        (command, options, reason, marked.start(*command, "--connect", endpoint, *options))
        for command in COMMANDS
        for reason, options in (
            ("needs a key of the fabric", ()),
            ("it is of another fabric than", ("--key", other)),
        )
    ]
    for command, options, reason, child in started:
        out, err = child.communicate()
        # A viewer says where to look before a conductor has heard of it.
        silent = command[0] != "viewer" or not options
        assert (child.returncode, bool(out)) == (2, not silent), (command, err)
        assert reason in err
        assert len(err.splitlines()) == 1, err
    status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    seen = json.loads(status.stdout)
    assert not seen["campaigns"]
    assert not seen["workers"]


def test_garbage_then_a_restart_with_the_same_key(marked, locked):
    state, endpoint, _ = locked
    port = int(endpoint.rpartition(":")[2])
    for data in (b"", b"\x00" * 100, b"\x16\x03\x01\x40\x00" + b"\x01" * 9000):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(data)
    key = (state / "keys/conductor.key").read_bytes()
    assert marked.run("conductor", "status", "--state", str(state)).returncode == 0
    process = marked.one("serve")
    process.send_signal(signal.SIGKILL)
    process.wait()
    child, again = serving(marked, state, "--listen", "tcp/0.0.0.0:0")
    assert again.endpoint == endpoint, "workers look for it at the old port"
    assert (state / "keys/conductor.key").read_bytes() == key
    assert marked.run("conductor", "stop", "--state", str(state)).returncode == 0
    assert child.wait() == 0


def test_keygen_serve_and_a_worker_in_the_open(marked, tmp_path):
    """A key of one's own; and what a worker must not open without one."""
    key = tmp_path / "mine"
    assert marked.run("conductor", "keygen", str(key)).returncode == 0
    state = tmp_path / "state"
    child, found = serving(marked, state, "--key", str(key))
    assert found.endpoint.startswith("tls/127.0.0.1:"), "with a key loopback is TLS too"
    assert (found.key, (state / "keys").exists()) == (str(key), False)
    assert marked.run("conductor", "status", "--state", str(state)).returncode == 0
    child.terminate()
    child.communicate()
    child, found = serving(marked, state)
    worker = marked.run(
        *("twin", "worker", "--connect", found.endpoint, "--drive-listen", "tcp/0.0.0.0:0")
    )
    assert worker.returncode == 2
    assert "tls/0.0.0.0:0: needs a key of the fabric" in worker.stderr
    child.terminate()
    child.communicate()
