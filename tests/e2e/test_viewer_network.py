"""A viewer on another host: mutual TLS, a network that is cut, a conductor that is killed."""

import signal
import subprocess

import pytest
from namespaces import hosts_in_a_row
from waiting import PATIENCE_S

pytestmark = pytest.mark.network


@pytest.fixture
def hosts():
    """Two hosts joined by a cable."""
    with hosts_in_a_row(2) as found:
        yield found


def line_with(viewer, words):
    """The viewer's next line that holds ``words``."""
    while line := viewer.stderr.readline():
        assert line.startswith("viewer: ")
        if words in line:
            return line
    raise AssertionError(f"the viewer has ended without '{words}'")


def cable(host, state):
    """Plug the cable of ``host`` in (``up``) or pull it out (``down``)."""
    names = subprocess.run(
        ["ip", "-n", host.name, "-o", "link", "show", "type", "veth"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    name = names.split(": ")[1].partition("@")[0]
    subprocess.run(["ip", "-n", host.name, "link", "set", name, state], check=True)


def test_what_happens_to_the_network_and_the_conductor_is_told_and_heals(marked, tmp_path, hosts):
    here, there = hosts
    endpoint = f"tls/{here.addresses[0]}:7447"
    for name in ("ours", "theirs"):
        assert marked.run("conductor", "keygen", str(tmp_path / name)).returncode == 0
    look = ("viewer", "live", "--connect", endpoint, "--no-window")

    def conduct():
        return marked.start(
            *("conductor", "serve", "--state", str(tmp_path / "state"), "--listen", endpoint),
            *("--key", str(tmp_path / "ours")),
            prefix=here.inside,
        )

    # Before the conductor.
    viewer = marked.start(*look, "--key", str(tmp_path / "ours"), prefix=there.inside)
    line_with(viewer, "waiting for it (Ctrl-C ends)")
    conductor = conduct()
    line_with(viewer, f"connected to {endpoint}")
    # With the key of another fabric.
    stranger = marked.start(*look, "--key", str(tmp_path / "theirs"), prefix=there.inside)
    _, err = stranger.communicate()
    assert stranger.returncode == 2
    assert "it is of another fabric" in err
    assert len(err.splitlines()) == 1
    # The cable is pulled out on the conductor's side: nobody over there hears of it.
    cable(here, "down")
    line_with(viewer, "waiting for it (Ctrl-C ends)")
    cable(here, "up")
    line_with(viewer, f"connected to {endpoint}")
    # The conductor is killed, and started again.
    conductor.send_signal(signal.SIGKILL)
    line_with(viewer, "waiting for it (Ctrl-C ends)")
    conductor.wait()
    conductor = conduct()
    line_with(viewer, f"connected to {endpoint}")
    viewer.send_signal(signal.SIGINT)
    assert viewer.wait(PATIENCE_S) == 0
    conductor.send_signal(signal.SIGINT)
    assert conductor.wait(PATIENCE_S) == 130
