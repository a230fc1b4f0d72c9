"""The tunnel with a stand-in for ssh that forwards for real."""

import io
import json
import os
import signal
import subprocess
import sys

import psutil
import pytest
from ssh_stand_in import put_first
from test_viewer_link import hear, hear_said, serve
from waiting import PATIENCE_S, wait_for

from twin.base.errors import InfrastructureError, UnreachableError, UsageError
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from viewer.live import link as linking
from viewer.live import tunnel
from viewer.live.link import Link, LinkEnded, Status
from viewer.live.slots import LatestSlots
from viewer.live.tunnel import Far, Tunnel
from viewer.playback import native


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """What ssh was called with so far."""
    monkeypatch.setattr(tunnel, "PAUSE_S", 0.1)
    return put_first(tmp_path, monkeypatch)


def dig(opened, **far):
    found = Tunnel(Far(**{"login": "me@login", **far}), "twin", None)
    opened.append(found)
    return found


def link_through(opened, way):
    link = Link(way.target, None, LatestSlots())
    opened.append(link)
    link.start()
    return link


def gone(pid):
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def stands(way):
    try:
        return bool(way.standing())
    except UnreachableError:
        return False


def test_through_the_login_node_to_a_compute_node(opened, calls, port):
    serve(opened, port)
    way = dig(opened, node="cn042", connect=f"tcp/127.0.0.1:{port}")
    link = link_through(opened, way)
    assert hear(link, Status).found["campaigns"]
    [call] = calls()
    assert call["host"] == "me@cn042"
    assert call["-J"] == ["me@login"]
    assert call["-L"][0].startswith("127.0.0.1:")
    assert call["-L"][0].endswith(f":127.0.0.1:{port}")
    way.close()
    wait_for(lambda: gone(call["pid"]), "the end of ssh")


def test_mutual_tls_through_the_tunnel(opened, calls, port, tmp_path):
    """The certificate is checked, not the address that it is reached at."""
    ours, _ = (make_keys(tmp_path / name) for name in ("ours", "theirs"))
    serve(opened, port, key=load_key(ours, Role.conductor))
    far = Far("me@login", "cn042", f"tls/127.0.0.1:{port}")
    for path, kind in ((tmp_path / "ours", Status), (tmp_path / "theirs", LinkEnded)):
        way = Tunnel(far, "twin", path)
        opened.append(way)
        heard = hear(link_through(opened, way), kind)
    assert "it is of another fabric" in str(heard.error)
    assert [call["host"] for call in calls()] == ["me@cn042"] * 2


def test_a_folder_over_there_says_where(opened, calls, port, tmp_path):
    way = dig(opened, folder=str(tmp_path))
    with pytest.raises(UnreachableError, match="no conductor serves this folder"):
        way.target()
    entry = {"pid": 1, "host": "cn007", "epoch": 1, "namespace": "mine", "version": "1"}
    (tmp_path / "conductor.json").write_text(
        json.dumps({"endpoint": f"tcp/127.0.0.1:{port}", **entry})
    )
    target = way.target()
    assert target.namespace == "mine"
    assert calls()[-1]["host"] == "me@cn007", "it listens on that node's loopback"
    (tmp_path / "conductor.json").write_text(json.dumps({"endpoint": "tls/cn007:7447", **entry}))
    with pytest.raises(UsageError, match=r"me@login has none that you may read; .* --role viewer"):
        way.target()
    page = Tunnel(Far("me@login", folder=str(tmp_path)), "twin", None, Role.admin)
    opened.append(page)
    with pytest.raises(UsageError, match=r"--role admin .* one of the role viewer looks only"):
        page.target()


def test_the_key_is_read_over_there_where_its_user_logs_in(opened, calls, port, tmp_path):
    """Nobody copies it: whoever may log in there may read it."""
    ours, theirs = (make_keys(tmp_path / name) for name in ("ours", "theirs"))
    serve(opened, port, key=load_key(ours, Role.conductor))
    entry = {"pid": 1, "host": "cn042", "epoch": 1, "namespace": "twin", "version": "1"}
    entry |= {"endpoint": f"tls/127.0.0.1:{port}"}
    for keys, kind in ((ours, Status), (theirs, LinkEnded)):
        (tmp_path / "conductor.json").write_text(json.dumps({**entry, "key": str(keys)}))
        way = dig(opened, folder=str(tmp_path))
        heard = hear(link_through(opened, way), kind)
    assert "it is of another fabric than me@login:" in str(heard.error)
    read = [call["command"] for call in calls() if call["command"].startswith("cat -- ")]
    assert f"cat -- {ours}/viewer.key" in read
    assert not [command for command in read if "viewer" not in command and ".key" in command]
    (theirs / "viewer.key").write_text("nonsense")
    with pytest.raises(UsageError, match=r"^me@login:.*/theirs/viewer.key: damaged"):
        dig(opened, folder=str(tmp_path)).target()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"endpoint": "garbage"}, "expected tcp/HOST:PORT"),
        ({"host": "-oProxyCommand=evil"}, "expected a host"),
        ({"host": "cn007;evil"}, "expected a host"),
    ],
)
def test_a_file_over_there_that_says_nonsense_is_the_end(opened, calls, tmp_path, changes, words):
    entry = {"pid": 1, "host": "cn007", "epoch": 1, "namespace": "mine", "version": "1"}
    text = json.dumps({"endpoint": "tcp/127.0.0.1:7447", **entry, **changes})
    (tmp_path / "conductor.json").write_text(text)
    error = hear(link_through(opened, dig(opened, folder=str(tmp_path))), LinkEnded).error
    assert isinstance(error, UsageError)
    assert words in str(error)
    assert "conductor.json" in str(error)
    assert len(calls()) == 1, "no tunnel was opened"


def test_a_key_is_fetched_from_a_folder_that_is_known(opened, calls):
    with pytest.raises(UsageError, match="needs a key of the fabric; ask for one") as caught:
        dig(opened, connect="tls/cn007:7447").target()
    assert "scp" not in str(caught.value)


def test_a_conductor_that_moves_is_followed(opened, calls, tmp_path):
    entry = {"pid": 1, "host": "", "epoch": 1, "namespace": "twin", "version": "1"}
    way = dig(opened, folder=str(tmp_path))
    for port in (7001, 7002):
        text = json.dumps({"endpoint": f"tcp/127.0.0.1:{port}", **entry})
        (tmp_path / "conductor.json").write_text(text)
        way.target()
        way.target()
        assert calls()[-2]["-L"][0].endswith(f":{port}"), "the later look-up opened nothing"


def test_a_tunnel_that_falls_is_dug_again(opened, calls, port, monkeypatch):
    for name, value in (("SILENCE_S", 0.6), ("ASK_S", 0.5), ("PERIOD_S", 0.1)):
        monkeypatch.setattr(linking, name, value)
    serve(opened, port)
    way = dig(opened, connect=f"tcp/127.0.0.1:{port}")
    link = link_through(opened, way)
    hear(link, Status)
    assert way.standing() == way.standing(), "it digs nothing"
    assert len(calls()) == 1
    os.kill(calls()[0]["pid"], signal.SIGKILL)
    hear_said(link, "connected")
    hear(link, Status)
    assert way.standing().endpoint.startswith("tcp/127.0.0.1:")
    first, *others = calls()  # more than one, if this machine is so busy that it fell once more
    assert "BatchMode=yes" not in first["-o"]
    assert others
    assert all("BatchMode=yes" in each["-o"] for each in others), "the terminal is in use"


def test_who_only_asks_for_the_tunnel_never_waits_for_it(opened, calls, port):
    way = dig(opened, connect=f"tcp/127.0.0.1:{port}")
    with pytest.raises(UnreachableError, match="tunnel to me@login does not stand"):
        way.standing()
    target = way.target()
    assert way.standing() == target
    os.kill(calls()[0]["pid"], signal.SIGKILL)
    wait_for(lambda: not stands(way), "the end of ssh, with all its threads")
    assert way.target() == way.standing()
    way.close()
    with pytest.raises(UnreachableError, match="does not stand"):
        way.standing()
    assert len(calls()) == 2


def test_a_tunnel_that_is_closed_while_it_is_dug_leaves_no_ssh(opened, calls, port, monkeypatch):
    way = dig(opened, connect=f"tcp/127.0.0.1:{port}")
    free_port = native.free_port

    def late():
        way.close()  # nothing has begun that it could end
        return free_port()

    monkeypatch.setattr(native, "free_port", late)
    with pytest.raises(UnreachableError, match="the tunnel to me@login is closed"):
        way.target()
    assert all(gone(call["pid"]) for call in calls())


class ClosedBefore:
    """Output of a child; the tunnel is closed just before it is read."""

    def __init__(self, output, way):
        self._output, self._way = output, way

    def readline(self):
        self._way.close()
        return self._output.readline()

    def close(self):
        self._output.close()


class ClosedAfter(ClosedBefore):
    """The same, when the read has begun, and ends with the child."""

    def readline(self):
        output, self._output = self._output, io.BytesIO()
        self._way.close()
        output.close()
        return b""


@pytest.mark.parametrize("kind", [ClosedBefore, ClosedAfter])
def test_a_tunnel_that_is_closed_while_the_far_end_speaks(opened, calls, port, monkeypatch, kind):
    way = dig(opened, connect=f"tcp/127.0.0.1:{port}")
    popen = subprocess.Popen

    def started(*words, **options):
        child = popen(*words, **options)
        child.stdout = kind(child.stdout, way)
        return child

    monkeypatch.setattr(tunnel.subprocess, "Popen", started)
    with pytest.raises(UnreachableError, match="the tunnel to me@login is closed"):
        way.target()
    monkeypatch.undo()
    assert all(gone(call["pid"]) for call in calls())


def test_hosts_that_are_not_there(opened, calls):
    with pytest.raises(InfrastructureError, match=r"ssh me@nowhere: .*Could not resolve") as caught:
        dig(opened, login="me@nowhere", connect="tcp/127.0.0.1:1").target()
    assert not isinstance(caught.value, UnreachableError), "waiting does not help"
    with pytest.raises(InfrastructureError, match="Could not resolve"):
        dig(opened, login="me@nowhere", folder="runs").target()


def test_mistakes(opened, calls, monkeypatch):
    with pytest.raises(UsageError, match="expected a host"):
        Far("-oProxyCommand=evil")
    with pytest.raises(UsageError, match="tcp/HOST:PORT"):
        dig(opened, connect="nonsense")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(UsageError, match="no ssh on this machine"):
        dig(opened, connect="tcp/127.0.0.1:1")


def test_it_ends_with_us_however_we_end(calls, port):
    program = (
        "import os, signal\n"
        "from viewer.live.tunnel import Far, Tunnel\n"
        f"Tunnel(Far('me@login', '', 'tcp/127.0.0.1:{port}'), 'twin', None).target()\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", program], timeout=PATIENCE_S)
    [call] = calls()
    wait_for(lambda: gone(call["pid"]), "the end of ssh")
