"""Two users of one network, same campaign name: they never hear each other, and nobody scouts."""

import json
import subprocess

import pytest
from namespaces import hosts_in_a_row
from processes import keys_of, wait_for

from twin.base.errors import TwinError
from twin.fabric.discovery import find_conductor

pytestmark = pytest.mark.network

CASES = {"alice": 5, "bob": 9}
"""User -> cases of a campaign that both call the same."""


@pytest.fixture
def hosts():
    with hosts_in_a_row(2) as found:
        yield found


class User:
    """A conductor of one's own, on the host ``here``, and what belongs to it."""

    def __init__(self, marked, folder, cases, here, listen):
        self._marked = marked
        self.state = folder / "state"
        self._here = here
        self.campaign = folder / "campaign.yaml"
        folder.mkdir()
        self.campaign.write_text(
            f"campaign: nightly\nsimulator: noop\nmatrix: {{repeat: {list(range(cases))}}}\n"
        )
        self.server = self.start(here, "conductor", "serve", "--listen", listen)
        self.endpoint = wait_for(self._endpoint, "the conductor")

    def _endpoint(self):
        try:
            return find_conductor(self.state).endpoint
        except TwinError:
            return ""

    def start(self, host, *command):
        return self._marked.start(*command, "--state", str(self.state), prefix=host.inside)

    def status(self):
        out, err = self.start(self._here, "conductor", "status", "--output", "json").communicate()
        assert out, err
        return json.loads(out)

    def done(self):
        found = self.status()
        return found if found["campaigns"]["nightly"]["left"] == 0 else None


def udp_sockets(host):
    """Lines of the kernel's tables of UDP sockets on ``host``: scouting would stand there."""
    tables = subprocess.run(
        [*host.inside, "cat", "/proc/net/udp", "/proc/net/udp6"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    return [line for line in tables.splitlines() if "local_address" not in line]


@pytest.mark.parametrize("over_network", [True, False])
def test_two_conductors_never_hear_each_other(marked, tmp_path, hosts, over_network):
    """Over the network, and on the loopback of one host; both have keys."""
    here, there = hosts if over_network else (hosts[0], hosts[0])
    listen = f"tcp/{here.addresses[0]}:0" if over_network else "tcp/127.0.0.1:0"
    users = {
        name: User(marked, tmp_path / name, cases, here, listen) for name, cases in CASES.items()
    }
    assert len({user.endpoint for user in users.values()}) == 2
    assert {user.endpoint[:3] for user in users.values()} == {"tls"}
    submitted = [
        user.start(here, "conductor", "submit", str(user.campaign)) for user in users.values()
    ]
    assert [child.communicate()[0][:9] for child in submitted] == ["submitted"] * 2
    # Alice's worker finds the work of alice alone, whose cases it ends; those of bob stay.
    workers = [users["alice"].start(there, "twin", "worker")]
    wait_for(users["alice"].done, "alice's cases")
    left = users["bob"].status()
    assert (left["campaigns"]["nightly"]["left"], left["workers"]) == (CASES["bob"], [])
    workers.append(users["bob"].start(there, "twin", "worker"))
    wait_for(users["bob"].done, "bob's cases")
    assert (udp_sockets(here), udp_sockets(there)) == ([], []), "nobody scouts"
    seen = {name: user.status() for name, user in users.items()}
    assert [len(found["workers"]) for found in seen.values()] == [1, 1]
    ids = {found["workers"][0]["id"] for found in seen.values()}
    assert len(ids) == 2
    for name, found in seen.items():
        row = found["campaigns"]["nightly"]
        assert (row["cases"], row["passed"]) == (CASES[name], CASES[name])
    stray = marked.start(
        *("twin", "worker", "--connect", users["bob"].endpoint),
        *("--key", str(keys_of(users["alice"].state))),
        prefix=there.inside,
    )
    _, err = stray.communicate()
    assert (stray.returncode, "is of another fabric than" in err) == (2, True), err
    for child in [*workers, *(user.server for user in users.values())]:
        child.terminate()
        _, err = child.communicate()
        assert "Traceback" not in err
