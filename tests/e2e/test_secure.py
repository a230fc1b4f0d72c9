"""A campaign over mutual TLS: same verdicts, and strangers get nothing of it."""

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from processes import PATIENCE_S, has_line_to, interrupt, keys_of, wait_for
from strangers import Stranger, certificates_on, options_of

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.control import StatusRequest
from twin.base.errors import TwinError
from twin.fabric.discovery import find_conductor
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role


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
    """Front and router, recorder feed, a viewer's hub and gate listen; the rig has no port."""
    out = tmp_path / "chaos-16"
    run = marked.start(
        *("conductor", "run", "chaos-16", "--workers", "1", "--slots", "4", "--out", str(out)),
        *("--view", "record+live", "--output", "json"),
    )
    viewer = marked.start(
        *("viewer", "live", "--run", str(out), "--wait", "60", "--no-window", "--output", "json")
    )
    wait_for(lambda: marked.processes("record"), "the recorder")
    stack = marked.one("host")
    stack.suspend()  # nothing ends while everybody is tried
    found = wait_for(lambda: len(ports(marked)) == 5 and ports(marked), "five listeners")
    keys = keys_of(out)
    secrets = [secret_of(path) for path in keys.glob("*.key")]
    assert len(secrets) == 6
    simulator = marked.one("sim")
    opened = Path(f"/proc/{marked.one('worker').pid}/fd").iterdir()
    own = [path for path in opened if path.is_file() and b"PRIVATE KEY" in path.read_bytes()]
    assert not own, "a rig on one host needs none"
    member = options_of(load_key(keys, Role.worker))
    at = [each.laddr.port for each in simulator.net_connections("tcp") if each.status == "LISTEN"]
    inside = [Stranger(f"tls/127.0.0.1:{port}", member, PATIENCE_S) for port in at]
    assert [each.inside for each in inside] == [True], "the feed"
    for each in inside:
        each.close()
    for kind, tls in certificates_on(keys, tmp_path).items():
        for port in found:
            protocol = "tcp" if kind == "plain" else "tls"
            stranger = Stranger(f"{protocol}/127.0.0.1:{port}", tls)
            assert not stranger.inside, f"{kind} at {found[port]}"
    for process in marked.processes():
        shown = "".join([*process.cmdline(), *process.environ().values()])
        assert not [secret for secret in secrets if secret in shown]
    stack.resume()
    stdout, stderr = run.communicate()
    assert run.returncode == 1, stderr
    assert json.loads(stdout)["fingerprint"] == quiet["fingerprint"]
    assert not [secret for secret in secrets if secret in stdout + stderr]
    said = "".join(path.read_text() for path in (out / "logs").iterdir())
    for reason in ("it showed no key", "its key is of another fabric or rig"):
        assert f"refused a connection: {reason}" in said, "the feed says why, too"
        count = stderr.count(f"refused a connection: {reason}")
        assert count in (1, 2), "and the conductor, once for each of its two ports"
    for path in out.rglob("*"):
        if path.is_file():
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
    _, found = serving(marked, tmp_path / "state", "--insecure")
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


REFUSAL_S = 2.0
"""Long enough to be told why, on a busy machine too [s]."""


def test_a_relay_says_whom_it_refuses(marked, locked, tmp_path):
    state, _, _ = locked
    relay = marked.start(
        *("conductor", "relay", "--listen", "tls/127.0.0.1:0", "--state", str(state))
    )
    entrance = relay.stdout.readline().split()[-1]
    for kind, tls in certificates_on(keys_of(state), tmp_path).items():
        there = entrance if kind != "plain" else "tcp" + entrance[3:]
        assert not Stranger(there, tls, REFUSAL_S).inside
    admin = ("--connect", entrance, "--key", str(keys_of(state)))
    assert marked.run("conductor", "status", *admin).returncode == 0
    relay.terminate()
    out, err = relay.communicate()
    assert (relay.returncode, out.splitlines()[1:]) == (0, [])
    said = [line for line in err.splitlines() if line.startswith("refused a connection: ")]
    assert {line.partition(": ")[2] for line in said} >= {
        "it does not speak TLS",
        "it showed no key",
        "its key is of another fabric or rig",
    }
    assert len(said) == len(set(said)) == len(err.splitlines()), "each once, and nothing else"


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
            # A host of a stack reads the key of a rig, not those of a conductor.
            (
                "it is of another fabric than",
                ("--key", f"{other}/worker.key" if command[0] == "devkit" else other),
            ),
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
    key = (keys_of(state) / "conductor.key").read_bytes()
    assert marked.run("conductor", "status", "--state", str(state)).returncode == 0
    process = marked.one("serve")
    process.send_signal(signal.SIGKILL)
    process.wait()
    child, again = serving(marked, state, "--listen", "tcp/0.0.0.0:0")
    assert again.endpoint == endpoint, "workers look for it at the old port"
    assert (keys_of(state) / "conductor.key").read_bytes() == key
    # An invitation leaked: new keys shut out everybody who holds an old one.
    leaked = state / "leaked.key"
    invite = ("conductor", "invite", "--role", "admin", "--state", str(state), "-o", str(leaked))
    assert marked.run(*invite).returncode == 0
    assert marked.run("conductor", "stop", "--key", str(leaked)).returncode == 0
    assert child.wait() == 0
    assert marked.run("conductor", "keygen", "--force", "--state", str(state)).returncode == 0
    child, again = serving(marked, state, "--listen", "tcp/0.0.0.0:0")
    late = marked.run("conductor", "stop", "--key", str(leaked), "--connect", again.endpoint)
    assert (late.returncode, "it is of another fabric" in late.stderr) == (2, True), late.stderr
    assert marked.run("conductor", "status", "--state", str(state)).returncode == 0
    child.terminate()
    child.communicate()


def test_keygen_and_serve(marked, tmp_path):
    """A key of one's own; one of another role leaves no trace."""
    key = tmp_path / "mine"
    assert marked.run("conductor", "keygen", str(key)).returncode == 0
    state = tmp_path / "state"
    for command in (("serve", "--state"), ("run", "chaos-16", "--out")):
        wrong = marked.run(*("conductor", *command, str(state)), *("--key", f"{key}/worker.key"))
        assert (wrong.returncode, "role worker may not serve" in wrong.stderr) == (2, True), wrong
    assert not state.exists()
    child, found = serving(marked, state, "--key", str(key))
    assert found.endpoint.startswith("tls/127.0.0.1:"), "with a key loopback is TLS too"
    assert (found.key, found.fabric, keys_of(state).exists()) == (str(key), "", False)
    assert marked.run("conductor", "status", "--state", str(state)).returncode == 0
    child.terminate()
    child.communicate()


def test_plain_beyond_loopback_is_typed_on_every_side(marked, tmp_path):
    """One word at the conductor, the workers and those who look; a line says what it means."""
    state = tmp_path / "state"
    child, found = serving(marked, state, "--insecure", "--listen", "tcp/0.0.0.0:0")
    assert (found.endpoint[:4], found.insecure, found.key) == ("tcp/", True, "")
    assert not keys_of(state).exists()
    place = ("--connect", found.endpoint)
    refused = [marked.start(*command, *place) for command in COMMANDS[:-1]]
    refused.append(marked.start("twin", "worker", "--state", str(state)))
    refused.append(marked.start("conductor", "status", "--state", str(state)))
    for each in refused:
        _, err = each.communicate()
        assert (each.returncode, len(err.splitlines())) == (2, 1), err
        assert "or type --insecure: whoever reaches it may then read and command" in err
    keys = str(make_keys(tmp_path / "keys"))
    both = marked.run("conductor", "serve", "--state", str(tmp_path), "--insecure", "--key", keys)
    assert (both.returncode, "leave one of them away" in both.stderr) == (2, True), both.stderr
    typed = (*place, "--insecure")
    assert marked.run("conductor", "submit", "chaos-16", *typed).returncode == 0
    look = marked.start("viewer", "live", "--no-window", *typed, "--output", "json")
    wait_for(lambda: has_line_to(look.pid, found.endpoint), "a viewer that sees all")
    worker = marked.start("twin", "worker", *typed)
    wait_for(lambda: any(state.glob("chaos-16/cases/*/attempt-1/kpi.parquet")), "a verdict")
    script = "from devkit.client import running_cases as f; import sys; f(connect=sys.argv[1]%s)"
    for option, code in ((", insecure=True", 0), ("", 1)):
        line = [sys.executable, "-c", script % option, found.endpoint]
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        assert (done.returncode, "or type --insecure" in done.stderr) == (code, bool(code)), done
    assert marked.run("conductor", "stop", *typed).returncode == 0
    assert worker.wait() == 0
    interrupt(look)
    assert json.loads(look.communicate()[0].splitlines()[-1])["received"] > 0
    child.wait()
    _, err = child.communicate()
    assert len([line for line in err.splitlines() if "INSECURE: plain TCP at tcp/" in line]) == 1
