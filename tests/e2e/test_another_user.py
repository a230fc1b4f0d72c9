"""Another user of this host, at a conductor that was started without any option about keys."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from processes import keys_of, wait_for

from twin.base.errors import TwinError
from twin.fabric.discovery import find_conductor

NOBODY = 65534
"""Another user than root."""

ATTACK = """
import json, os, sys
from pathlib import Path
from strangers import SILENCE_S, Stranger, certificates_on, options_of
from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.control import StatusRequest, Submit
from schemas.wire.codec import encode
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import MEMBERS

port, keys, own = sys.argv[1:]
load_key(make_keys(Path(own) / "warm"), MEMBERS[0])  # what it imports may be out of reach below
os.setgroups([])
os.setgid({nobody})
os.setuid({nobody})
own = Path(own) / "theirs"
own.mkdir()
tls = {{"nothing": ("tcp", {{}}), "no certificate": ("tls", {{}})}}
for role in MEMBERS:
    folder = make_keys(own / str(role))
    tls[f"own {{role}}"] = ("tls", options_of(load_key(folder, role)))
code = {{
    "campaign": "theirs",
    "simulator": "noop",
    "autonomy": {{"command": ["id"]}},
    "matrix": {{"repeat": [0]}},
}}
submission = encode(Submit(v=SCHEMA_VERSION, campaign=code))
status = encode(StatusRequest(v=SCHEMA_VERSION))
asked = [(topic.key, submission) for topic in topics.TOPICS if topic.key.startswith("conductor/r")]
asked.append((topics.RPC_STATUS.key, status))
inside, answered = [], 0
for name, (protocol, options) in tls.items():
    stranger = Stranger(f"{{protocol}}/127.0.0.1:{{port}}", options)
    if stranger.inside:
        inside.append(name)
        answered += sum(len(found) for found in stranger.answers(asked, SILENCE_S))
    stranger.close()
read = []
for path in (Path(keys), Path(keys).parent, *(Path(keys) / f"{{role}}.key" for role in MEMBERS)):
    try:
        os.listdir(path) if path.suffix == "" else path.read_bytes()
        read.append(str(path))
    except PermissionError:
        pass
print(json.dumps({{"inside": inside, "answered": answered, "read": read, "uid": os.getuid()}}))
"""


@pytest.fixture
def state(marked, tmp_path):
    """The folder of a conductor on this host's loopback, as it is by default."""
    folder = tmp_path / "state"
    child = marked.start("conductor", "serve", "--state", str(folder))

    def found():
        try:
            return find_conductor(folder)
        except TwinError:
            assert child.poll() is None, child.communicate()
            return None

    wait_for(found, "the conductor")
    yield folder
    child.terminate()
    child.communicate()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become another user")
def test_another_user_of_this_host_has_nothing_run(marked, state):
    """He finds the port, which everybody may, and tries it with what he can make himself."""
    endpoint = find_conductor(state).endpoint
    own = Path(tempfile.mkdtemp(prefix="another-user-"))  # folders of tests are root's alone
    own.chmod(0o777)
    try:
        done = subprocess.run(
            [
                *(sys.executable, "-c", ATTACK.format(nobody=NOBODY)),
                *(endpoint.rpartition(":")[2], str(keys_of(state)), str(own)),
            ],
            capture_output=True,
            text=True,
            check=False,
            cwd=Path(__file__).parent,
        )
    finally:
        subprocess.run(["rm", "-rf", str(own)], check=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"inside": [], "answered": 0, "read": [], "uid": NOBODY}
    status = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    found = json.loads(status.stdout)
    assert (found["campaigns"], found["counters"]["refused"]) == ({}, 0), "nothing got that far"
    assert endpoint.startswith("tls/127.0.0.1:")


def test_who_started_it_types_no_key(marked, state, tmp_path):
    """Submit, look, steer and stop by the state folder alone."""
    campaign = tmp_path / "mine.yaml"
    campaign.write_text("campaign: mine\nsimulator: noop\nmatrix: {repeat: [0, 1]}\n")
    where = ("--state", str(state))
    for command in (
        ("submit", str(campaign), *where),
        ("status", *where),
        ("explain", "mine", "repeat_0", *where),
        ("pause", "mine", *where),
        ("resume", "mine", *where),
    ):
        done = marked.run("conductor", *command)
        assert done.returncode == 0, (command, done.stderr)
    worker = marked.run("twin", "worker", *where, "--until-done")
    assert worker.returncode == 0, worker.stderr
    done = marked.run("conductor", "stop", *where)
    assert done.returncode == 0, done.stderr
    assert not (state / "keys").exists(), "nor does one lie where a stack may look"
    held = [path for path in state.rglob("*") if path.is_file()]
    assert held
    assert not [path for path in held if b"PRIVATE KEY" in path.read_bytes()]


def test_plain_loopback_has_to_be_typed_and_is_told(marked, tmp_path):
    """On every side; the first screen says what it means."""
    folder = tmp_path / "state"
    child = marked.start("conductor", "serve", "--state", str(folder), "--insecure")
    for _ in range(6):
        child.stdout.readline()
    found = find_conductor(folder)
    assert (found.endpoint[:14], found.insecure) == ("tcp/127.0.0.1:", True)
    where = ("--connect", found.endpoint)
    commands = (
        *(("conductor", "status"), ("conductor", "submit", "chaos-16"), ("twin", "worker")),
        *(("conductor", "stop"), ("viewer", "live", "--no-window")),
    )
    started = [marked.start(*command, *place) for command in commands for place in (where,)]
    started.append(marked.start("twin", "worker", "--state", str(folder)))
    for each in started:
        _, err = each.communicate()
        assert (each.returncode, len(err.splitlines())) == (2, 1), (each.args, err)
        assert "any user of this host may pose as the other side" in err
        assert "or type --insecure" in err
    assert marked.run("conductor", "status", *where, "--insecure").returncode == 0
    child.terminate()
    _, err = child.communicate()
    said = [line for line in err.splitlines() if "INSECURE" in line]
    assert len(said) == 1
    assert "anybody on this host may" in said[0]
    assert "run commands as you" in said[0]
